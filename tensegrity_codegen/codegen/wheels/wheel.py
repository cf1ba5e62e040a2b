"""A wheel of a compiled library: names, tags, metadata and archive, the same bytes for the same library.

Formats: the Python packaging specifications of binary distributions, of core metadata and of names.
"""

import base64
import hashlib
import io
import json
import keyword
import re
import sysconfig
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from tensegrity_codegen.codegen.wheels import bundled
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.system.errors import FormulationError, InvalidNameError
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.integrators import find_row
from tensegrity_codegen.tables.manifest import (
    ArgumentSpec,
    FunctionSpec,
    IntegratorSpec,
    Manifest,
    SolverSpec,
)
from tensegrity_codegen.tables.targets import TARGETS, Target, find_target

NAMES = ("node_name", "member_name", "coordinate_name", "input_name")


def format_module(manifest: Manifest, file_name: str, version: str) -> str:
    """Return the text of `__init__.py` of the package of a library."""
    functions = [_format_function(manifest, spec) for spec in manifest.functions]
    functions += [_format_integrator(manifest, spec) for spec in manifest.integrators]
    functions += [_format_solver(manifest, spec) for spec in manifest.solvers]
    classes = sorted(bundled.__all__)
    public = sorted(
        [
            *(name.upper() + "S" for name in NAMES),
            *("CONNECTIVITY", "LIBRARY", "NODE_POSITION", "nominal", *classes),
            *(f"compute_{spec.quantity}" for spec in manifest.functions),
            *(f"integrate_{spec.name}" for spec in manifest.integrators),
            *(f"find_{spec.name}" for spec in manifest.solvers),
        ]
    )
    return "\n".join(
        [
            *_format_head(manifest, public),
            f"__version__ = {json.dumps(version)}",
            "",
            f"LIBRARY = Library(_Path(__file__).parent, {json.dumps(file_name)})",
            *(f'{name.upper()}S: tuple[str, ...] = LIBRARY.names("{name}")' for name in NAMES),
            "# Nodes of each member, (n_members, 2); positions of the nodes in the scene, (n_nodes, 3) [m].",
            'CONNECTIVITY: _NDArray[_Any] = _np.array(LIBRARY.manifest["connectivity"]).reshape(-1, 2)',
            'NODE_POSITION: _NDArray[_Any] = _np.array(LIBRARY.manifest["node_position"]).reshape(-1, 3)',
            "",
            "",
            *NOMINAL,
            *functions,
        ]
    )


NOMINAL = [
    "def nominal(argument: str) -> _NDArray[_Any]:",
    '    """Return the value of an argument in the scene, as a new array; KeyError for an unknown one."""',
    "    return LIBRARY.nominal(argument)",
    "",
]


def _format_head(manifest: Manifest, public: Sequence[str]) -> list[str]:
    counts = (
        f"{describe_count(len(manifest.node_name), 'node')}, "
        f"{describe_count(len(manifest.member_name), 'member')}, "
        f"{len(manifest.coordinate_name)} free coordinates"
    )
    made_by = ", ".join(f"{program} {release}" for program, release in manifest.made_by.items())
    head = (
        f"Tensegrity structure {manifest.name}: {counts}.\n\n"
        f"Written by {made_by}. SI units; tensions are positive in tension. An argument that is not\n"
        "given has its value in the scene. A status of the library that is not 0 is raised as a StatusError."
    )
    return [
        f'"""{_quote(head)}\n"""',
        "",
        "from __future__ import annotations",
        "",
        "from pathlib import Path as _Path",
        "from typing import Any as _Any",
        "",
        "import numpy as _np",
        "from numpy.typing import ArrayLike as _ArrayLike",
        "from numpy.typing import NDArray as _NDArray",
        "",
        "from ._library import (",
        *(f"    {name}," for name in sorted(bundled.__all__)),
        ")",
        "",
        "__all__ = [",
        *(f"    {json.dumps(name)}," for name in public),
        "]",
    ]


def _format_function(manifest: Manifest, spec: FunctionSpec) -> str:
    arguments = [manifest.argument(name) for name in spec.arguments]
    if spec.pattern is not None:
        kind, call = "SparseMatrix", "LIBRARY.compute_sparse({})"
    elif spec.shape == ():
        kind, call = "float", "float(LIBRARY.compute({}))"
    else:
        kind, call = "_NDArray[_Any]", "LIBRARY.compute({})"
    returned = f"{spec.quantity} : {spec.shape or 'scalar'} [{spec.unit}]"
    return _format_definition(
        f"compute_{spec.quantity}",
        [],
        arguments,
        kind,
        f"{spec.sentence}",
        [],
        returned,
        call.format(f'"{spec.quantity}", {_pass(arguments)}'),
    )


def _format_integrator(manifest: Manifest, spec: IntegratorSpec) -> str:
    arguments = _with_state(manifest, spec.arguments)
    sample = ("sample_time: _ArrayLike | None = None", "sample_time : (n_samples,) [s]", "Ascending times.")
    row = find_row(spec.name, manifest.needs_state_jacobian)
    if row.kind == "fixed":
        name = "the classical Runge-Kutta method" if spec.name == "rk4" else f"the method {spec.name}"
        title = f"Motion by {name} with fixed steps; steps do not end at events."
        options = [
            ("step: float", "step : float [s]", "Length of a step."),
            ("n_steps: int", "n_steps : int", "Number of steps."),
            (*sample[:2], "Ascending times; default: the end of each step."),
        ]
        call = f'LIBRARY.integrate_steps("{spec.name}", step, n_steps, sample_time, {_pass(arguments)})'
    else:
        title = f"Motion by the method {spec.name} with error control; steps do not end at events."
        options = [
            ("t_end: float", "t_end : float [s]", "End of the motion, which starts at 0."),
            ("rtol: float = 1e-6", "rtol : float", "Relative tolerance of the state."),
            ("atol: float = 1e-9", "atol : float", "Absolute tolerance of the state."),
            ("most_steps: int = 1_000_000", "most_steps : int", "Largest number of steps."),
            (*sample[:2], "Ascending times; default: 101 over the whole time."),
        ]
        numbers = "t_end, rtol, atol, most_steps, sample_time"
        kind = ", is_implicit=True" if row.kind == "implicit" else ""
        call = f'LIBRARY.integrate("{spec.name}", {numbers}, {_pass(arguments)}{kind})'
    return _format_definition(
        f"integrate_{spec.name}", options, arguments, "Motion", title, options, "motion : Motion", call
    )


def _format_solver(manifest: Manifest, spec: SolverSpec) -> str:
    arguments = _with_state(manifest, spec.arguments, ("coordinate",))
    options = [
        ("tolerance: float = 1e-9", "tolerance : float", "Largest static force at an equilibrium."),
        ("most_iterations: int = 100", "most_iterations : int", "Largest number of Newton steps."),
    ]
    return _format_definition(
        f"find_{spec.name}",
        options,
        arguments,
        "Equilibrium",
        "A minimum of the potential energy near `coordinate`, by Newton's method.",
        options,
        "equilibrium : Equilibrium",
        f"LIBRARY.find_equilibrium(tolerance, most_iterations, {_pass(arguments)})",
    )


def _with_state(
    manifest: Manifest, names: Iterable[str], state: Sequence[str] = ("coordinate", "velocity")
) -> list[ArgumentSpec]:
    """Return the arguments that a search or a motion starts from, and those that it passes on."""
    return [manifest.argument(name) for name in dict.fromkeys((*state, *names))]


def _format_definition(
    name: str,
    options: Sequence[tuple[str, str, str]],
    arguments: Sequence[ArgumentSpec],
    kind: str,
    title: str,
    described: Sequence[tuple[str, str, str]],
    returned: str,
    call: str,
) -> str:
    """Return the text of one function; options: parameter, its line and its sentence in the documentation."""
    parameters = [option[0] for option in options] + ["*"] * bool(options and arguments)
    parameters += [f"{_python_name(argument.name)}: _ArrayLike | None = None" for argument in arguments]
    lines = ["", f"def {name}({', '.join(parameters)}) -> {kind}:", f'    """{_quote(title)}', ""]
    rows = [(option[1], option[2]) for option in described]
    rows += [
        (
            f"{argument.name} : {argument.shape or 'scalar'} [{argument.unit}]",
            argument.sentence + (f" Of {', '.join(argument.over)}." if argument.over else ""),
        )
        for argument in arguments
    ]
    if rows:
        lines += ["    Parameters", "    ----------"]
        for head, sentence in rows:
            lines += [f"    {_quote(head)}", f"        {_quote(sentence)}"]
        lines.append("")
    lines += ["    Returns", "    -------", f"    {_quote(returned)}", '    """', f"    return {call}", ""]
    return "\n".join(lines)


def _pass(arguments: Sequence[ArgumentSpec]) -> str:
    return (
        "{" + ", ".join(f'"{argument.name}": {_python_name(argument.name)}' for argument in arguments) + "}"
    )


def _python_name(name: str) -> str:
    if not name.isidentifier() or keyword.iskeyword(name):
        raise InvalidNameError("Python cannot have an argument of this name", where="wheel", given=name)
    return name


def _quote(text: str) -> str:
    """Return text as it stands in a documentation string."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


PREFIX = "tensegrity_"
OWN_PACKAGE = "tensegrity_codegen"
NUMPY = "numpy>=1.26"
PYTHON = ">=3.10"
DATE = (1980, 1, 1, 0, 0, 0)  # the first that an archive can have
FILE_MODE = 0o644 << 16


def name_package(scene: str) -> str:
    """Return the name by which the package of a scene is imported; raises InvalidNameError."""
    name = PREFIX + scene
    if name == OWN_PACKAGE:
        raise InvalidNameError(
            "the Python package of this scene would have the name of the package that generates it",
            where="name",
            given=scene,
            allowed="any other name of a scene",
            hint=f"rename the scene, for example {scene}_scene",
        )
    return name


def name_distribution(scene: str) -> str:
    """Return the name by which the package of a scene is installed.

    Such names ignore case and runs of `_`; a scene whose name has them gets six digits of its hash.
    """
    plain = re.sub(r"_+", "_", name_package(scene)).strip("_").lower()
    if plain == PREFIX + scene:
        return plain
    return f"{plain}_{hashlib.sha256(scene.encode('utf-8')).hexdigest()[:6]}"


def check_wheel(target: Target, scene: str, where: str = "target") -> None:
    """Raise FormulationError, naming `where`, or InvalidNameError if there cannot be a wheel."""
    name_package(scene)
    if target.name and not target.wheel_tag:
        raise FormulationError(
            f"a {target.kind} is not a library that Python loads",
            where=where,
            given=target.name,
            allowed=", ".join(name for name, target_spec in TARGETS.items() if target_spec.wheel_tag),
            hint="build for one of these machines, or without a wheel",
        )


def build_wheel(manifest: Manifest, library: Path) -> tuple[str, bytes]:
    """Return file name and content of the wheel of a compiled library."""
    if manifest.contact_name:
        raise refuse_ground(manifest.name, "a package of the library alone")
    check_wheel(find_target(manifest.target or None), manifest.name)
    package, name = name_package(manifest.name), name_distribution(manifest.name)
    version, tag = _version(manifest), _tag(manifest)
    files = {
        f"{package}/__init__.py": format_module(manifest, library.name, version).encode("utf-8"),
        f"{package}/_library.py": Path(bundled.__file__).read_bytes(),
        f"{package}/py.typed": b"",
        f"{package}/manifest.json": manifest.to_json().encode("utf-8"),
        f"{package}/{library.name}": library.read_bytes(),
    }
    info = f"{name}-{version}.dist-info"
    files[f"{info}/METADATA"] = _format_metadata(manifest, package, name, version).encode("utf-8")
    tags = "".join(f"Tag: py3-none-{platform}\n" for platform in tag.split("."))
    made = f"Wheel-Version: 1.0\nGenerator: tensegrity_codegen {VERSION}\nRoot-Is-Purelib: false\n"
    files[f"{info}/WHEEL"] = (made + tags).encode("utf-8")
    files[f"{info}/RECORD"] = _format_record(files, f"{info}/RECORD").encode("utf-8")
    return wheel_file_name(manifest), _pack(files)


def wheel_file_name(manifest: Manifest) -> str:
    """Return the file name of the wheel of a library."""
    return f"{name_distribution(manifest.name)}-{_version(manifest)}-py3-none-{_tag(manifest)}.whl"


def _version(manifest: Manifest) -> str:
    """Return the version of a wheel, another one for each scene and request."""
    return f"{VERSION}+g{manifest.scene_hash[:8]}"


def _tag(manifest: Manifest) -> str:
    """Return the platform tag; that of this machine makes no promise for other distributions of Linux."""
    if manifest.target:
        return TARGETS[manifest.target].wheel_tag
    return re.sub(r"[-.]", "_", sysconfig.get_platform())


def _format_metadata(manifest: Manifest, package: str, name: str, version: str) -> str:
    nodes, members = len(manifest.node_name), len(manifest.member_name)
    counts = f"{describe_count(nodes, 'node')} and {describe_count(members, 'member')}"
    functions = "\n".join(f"- `{package}.compute_{spec.quantity}`" for spec in manifest.functions)
    return (
        "Metadata-Version: 2.1\n"
        f"Name: {name.replace('_', '-')}\n"
        f"Version: {version}\n"
        f"Summary: Compiled library of the tensegrity structure {manifest.name}, {counts}\n"
        f"Requires-Python: {PYTHON}\n"
        f"Requires-Dist: {NUMPY}\n"
        "Classifier: Topic :: Scientific/Engineering :: Physics\n"
        "Classifier: Typing :: Typed\n"
        "Description-Content-Type: text/markdown\n"
        "\n"
        f"Import it as `{package}`. Written by tensegrity_codegen {VERSION} from a scene file;\n"
        f"`help({package})` describes functions, shapes and units.\n\n{functions}\n"
    )


def _format_record(files: Mapping[str, bytes], record_name: str) -> str:
    rows = []
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode("ascii")
        rows.append(f"{name},sha256={digest},{len(content)}\n")
    return "".join(rows) + f"{record_name},,\n"


def _pack(files: Mapping[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, FILE_MODE
            archive.writestr(entry, content)
    return packed.getvalue()
