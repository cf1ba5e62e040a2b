"""C text of DAQP's solver as a controller includes it: static functions of one precision, without malloc.

Of the source archive only the solver of least-distance programs is used: daqp.c, auxiliary.c, factorization.c
and their headers. `quadratic_program.h` and `mpc_program.h` in `templates/c/control/` make such programs.
The archive is a file of the user, the copy in the cache, or a download by pip; it is verified.
"""

import io
import re
import tarfile
from pathlib import Path

from tensegrity_codegen.system.errors import MissingSourceError
from tensegrity_codegen.system.pinned_file import PinnedFile

DAQP_VERSION = "0.11.0"
DAQP_ARCHIVE = f"daqp-{DAQP_VERSION}.tar.gz"
DAQP_SHA256 = "2f27baf18d2acca14186498e651b34e0bed455627e777d3fd8ba655e7e40f920"
DAQP = PinnedFile(
    package="daqp",
    version=DAQP_VERSION,
    file=DAQP_ARCHIVE,
    sha256=DAQP_SHA256,
    title="the source archive of DAQP",
    is_source=True,
    hand="daqp_sdist=PATH",
)
ROOT = f"daqp-{DAQP_VERSION}"
PARTS = (
    "include/types.h",
    "include/constants.h",
    "include/factorization.h",
    "include/auxiliary.h",
    "include/daqp.h",
    "src/factorization.c",
    "src/auxiliary.c",
    "src/daqp.c",
)
GUARD = re.compile(r"\A\s*#ifndef (\w+_H)\n#\s*define \1\n(.*)#endif[^\n]*\s*\Z", re.DOTALL)
CPLUSPLUS = re.compile(r"# *ifdef __cplusplus\n.*?# *endif[^\n]*\n", re.DOTALL)
PROFILING = re.compile(r"#ifdef PROFILING\n.*?#endif[^\n]*\n", re.DOTALL)
INCLUDE = re.compile(r'#include [<"][^>"]*[>"]\n')
PRECISION = re.compile(r"#ifdef DAQP_SINGLE_PRECISION\n.*?#endif\n", re.DOTALL)
OUTER = re.compile(
    r"^(?=(?:void|int|c_float) (?:daqp_\w+|ldp2qp_solution|reset_daqp_workspace)\()", re.MULTILINE
)
COMMENT = re.compile(r"(/\*.*?\*/|//[^\n]*)", re.DOTALL)
DOUBLE = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")
# What no program of a controller has: binary constraints and levels of priority; and what some have.
ABSENT = ("DAQP_IS_BINARY(x)", "DAQP_IS_HIERARCHICAL(work)")
SOFT_CONSTRAINTS = ("DAQP_IS_SOFT(x)", "DAQP_HAS_L1(work)")
# Added: a limit of the active constraints, which rounding can make more than their memory holds.
LIMITED = {
    "int iter_limit;": "int iter_limit, most_active;",
    "iter < work->settings->iter_limit;": "iter < work->settings->iter_limit"
    " && work->n_active < work->settings->most_active;",
}
SILENCED = (
    "conversion", "sign-conversion", "double-promotion", "float-conversion", "shadow", "sign-compare",
    "unused-function", "unused-parameter", "unused-variable", "unused-but-set-variable",
)  # fmt: skip
HEAD = """\
/* DAQP {version}, a dual active-set solver: csrc/{{include,src}} of {archive}
 * (SHA-256 {digest}),
 * under the licence below. Changed by tensegrity_codegen: one file of static functions; double or single
 * precision is chosen; active constraints are limited; {absent}binary constraints, levels of priority,
 * timing, and declarations for C++ are left out.
 *
{licence} */
#ifndef DAQP_STATIC_H
#define DAQP_STATIC_H

#include <float.h>
#include <stddef.h>

#if defined(__GNUC__)
#pragma GCC diagnostic push
{silenced}#endif
"""
TAIL = """\
#if defined(__GNUC__)
#pragma GCC diagnostic pop
#endif

#endif
"""


def find_daqp_archive(file: str | Path | None = None) -> bytes:
    """Return the source archive of DAQP, of the pinned version and SHA-256."""
    return DAQP.find(file)


def emit_daqp(archive: bytes, *, single: bool = False, soft: bool = False) -> str:
    """Return DAQP's solver as one C file of static functions."""
    files = _read(archive)
    lines = [f" * {line.replace('*/', '* /')}".rstrip() for line in files["LICENSE"].strip().splitlines()]
    head = HEAD.format(
        version=DAQP_VERSION,
        archive=DAQP_ARCHIVE,
        digest=DAQP_SHA256,
        absent="" if soft else "soft and ",
        licence="\n".join(lines) + "\n",
        silenced="".join(f'#pragma GCC diagnostic ignored "-W{name}"\n' for name in SILENCED),
    )
    text = "\n".join(_join(files[f"csrc/{name}"]) for name in PARTS)
    for macro in ABSENT if soft else (*SOFT_CONSTRAINTS, *ABSENT):
        defined = re.compile(rf"#define {re.escape(macro)}(?:[^\n]*\\\n)*[^\n]*\n")
        text = _substitute(defined, f"#define {macro} 0\n", text)
    for old, new in LIMITED.items():
        text = _substitute(re.compile(re.escape(old)), new, text)
    text = _substitute(PRECISION, f"typedef {'float' if single else 'double'} c_float;\n", text)
    text = OUTER.sub("static ", text)
    if single:
        # Literals of single precision, comments as they are.
        pieces = COMMENT.split(text)
        for k in range(0, len(pieces), 2):
            pieces[k] = DOUBLE.sub(r"\1f", pieces[k]).replace("DBL_EPSILON", "FLT_EPSILON")
        text = "".join(pieces)
    return f"{head}{_tidy(text)}\n{TAIL}"


def read_daqp_licence(archive: bytes) -> str:
    """Return the text of DAQP's licence."""
    return _read(archive)["LICENSE"]


def _read(archive: bytes) -> dict[str, str]:
    """Return the files that are used, by their paths in the archive."""
    names = ("LICENSE", *(f"csrc/{name}" for name in PARTS))
    contents = {}
    try:
        with tarfile.open(fileobj=io.BytesIO(archive), mode="r:gz") as tar:
            for name in names:
                stream = tar.extractfile(f"{ROOT}/{name}")
                contents[name] = b"" if stream is None else stream.read()
    except (KeyError, tarfile.TarError, OSError, EOFError) as error:
        raise MissingSourceError(
            "the archive of DAQP is damaged", where=DAQP_ARCHIVE, given=str(error)
        ) from error
    return {name: data.decode("utf-8").replace("\r\n", "\n") for name, data in contents.items()}


def _join(text: str) -> str:
    """Return a file without its guard, includes, and branches for C++ and timing."""
    guarded = GUARD.match(text)
    text = text if guarded is None else guarded[2]
    for pattern in (CPLUSPLUS, PROFILING, INCLUDE):
        text = pattern.sub("", text)
    return text


def _substitute(pattern: re.Pattern[str], new: str, text: str) -> str:
    text, count = pattern.subn(lambda _: new, text)
    if not count:
        raise MissingSourceError(
            "the archive of DAQP does not hold the expected text", where=DAQP_ARCHIVE, given=pattern.pattern
        )
    return text


def _tidy(text: str) -> str:
    lines = [line.rstrip() for line in text.splitlines()]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip("\n") + "\n"
