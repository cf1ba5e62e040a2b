"""The emitter and compiler of a library, settled by measurement and remembered.

Candidates are the emitters that serve a request, the compilers of this machine and sets of flags. Each is
compiled with a driver that times the wanted functions at nominal values (codegen/measure.py); the least sum
wins. The decision is kept in the cache, beside the library that it led to.
"""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.codegen.compilation.fingerprint import hash_package, hash_scene, hash_text
from tensegrity_codegen.codegen.compilation.flags import (
    Compiler,
    FlagSet,
    describe_cpu,
    describe_toolchain,
    find_flags,
)
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler, find_compilers
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.pipeline.build_library import BuiltLibrary, build_library
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import TensegrityError, check_choice
from tensegrity_codegen.system.temporary_files import work_folder
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class TuningRow:
    """One candidate: median ns a call of each wanted function, their sum, or why there is none."""

    emitter: str
    compiler: str = ""  # its family
    version: str = ""
    command: str = ""  # of the compiler
    flags: str = ""
    ns: Mapping[str, float] = field(default_factory=dict)
    total: float | None = None  # of what was asked for, None where `problem` says why
    problem: str = ""


@dataclass(frozen=True)
class TunedLibrary:
    """The library of the fastest candidate, all candidates, and whether they were measured before."""

    built: BuiltLibrary
    rows: tuple[TuningRow, ...]
    by: str  # the quantity whose time decided; "sum" for all that are wanted
    from_cache: bool

    @property
    def chosen(self) -> TuningRow:
        """The candidate that won."""
        return fastest(self.rows)


def build_tuned(
    structure: Subject,
    request: ModelRequest,
    *,
    compiler: str | None = None,
    flags: Sequence[str] = (),
    tune_for: str | None = None,
    cache: Cache | None = None,
    measure: bool = False,
) -> TunedLibrary:
    """Return the library that measures fastest, of all compilers and emitters that are not stated."""
    cache = cache or Cache()
    if tune_for is not None:
        check_choice(tune_for, request.quantities, "requested quantity", "tune_for")
    sets = [find_flags(name, "flags") for name in dict.fromkeys(flags or (request.flags,))]
    named = [find_compiler(compiler)] if compiler is not None else find_compilers()
    tools = [(tool, flag_set) for tool in named or [find_compiler()] for flag_set in sets]
    key = _tuning_key(structure, request, tools, tune_for)
    rows = _read_rows(cache, key)
    is_compared = bool(rows)
    if not is_compared:
        rows = _measure(structure, request, tools, tune_for)
    best = fastest(rows)
    tuned_request = replace(request, emitter=best.emitter, flags=best.flags)
    built = build_library(structure, tuned_request, compiler=best.command, cache=cache, measure=measure)
    if not is_compared:
        cache.store_request(key, built.entry.key, {"rows": [asdict(row) for row in rows]})
    counted = sum(row.total is not None for row in rows)
    measured = tune_for or "all requested functions"
    why = f"measured: {best.total:.1f} ns for {measured}, the least of {counted} candidates"
    return TunedLibrary(replace(built, why_emitter=why), rows, tune_for or "sum", is_compared)


def fastest(rows: Sequence[TuningRow]) -> TuningRow:
    """Return the row with the least total; ValueError if no row has one."""
    return min((row for row in rows if row.total is not None), key=lambda row: row.total or 0.0)


def _tuning_key(
    structure: Subject, request: ModelRequest, tools: Sequence[tuple[Compiler, FlagSet]], by: str | None
) -> str:
    """Return the key of all that a measurement depends on, the machine with it."""
    return hash_text(
        "tuning",
        hash_scene(structure, request),
        hash_package(Path(__file__).resolve().parents[1], template_folder()),
        version("casadi"),
        *(describe_toolchain(tool, flags) for tool, flags in tools),
        describe_cpu(),
        by or "",
    )


def _read_rows(cache: Cache, key: str) -> tuple[TuningRow, ...]:
    """Return the rows that were stored under that key; empty if there are none that can be used."""
    note: Any = cache.lookup_note(key).get("rows")
    try:
        rows = tuple(TuningRow(**row) for row in note or ())
        good = all(row.total is None or math.isfinite(row.total) for row in rows)
    except TypeError:
        return ()
    return rows if good and any(row.total is not None for row in rows) else ()


def _measure(
    structure: Subject, request: ModelRequest, tools: Sequence[tuple[Compiler, FlagSet]], by: str | None
) -> tuple[TuningRow, ...]:
    """Return a row for each candidate; raises the first error if none of them works."""
    # Imported here, so that a decision from the cache costs no import of CasADi.
    from tensegrity_codegen.codegen.choose_emitter import list_candidates
    from tensegrity_codegen.codegen.emit import emit
    from tensegrity_codegen.codegen.measure import build_driver, run_drivers

    rows: list[TuningRow] = []
    errors: list[TensegrityError] = []
    programs: dict[int, Path] = {}
    with work_folder() as work_path:
        for emitter in list_candidates(structure, request):
            try:
                source = emit(structure, replace(request, emitter=emitter))
            except TensegrityError as error:
                rows.append(TuningRow(emitter, problem=error.problem))
                errors.append(error)
                continue
            for tool, flags in tools:
                row = TuningRow(emitter, tool.name, tool.version, shlex.join(tool.command), flags.name)
                folder = work_path / str(len(rows))
                folder.mkdir()
                try:
                    programs[len(rows)] = build_driver(source, tool, flags, folder)
                except TensegrityError as error:
                    row = replace(row, problem=error.problem)
                    errors.append(error)
                rows.append(row)
        # All are timed after all are compiled, so that no compiler runs beside a measurement.
        answers = run_drivers(list(programs.values()))
    for number, answer in zip(programs, answers, strict=True):
        if isinstance(answer, TensegrityError):
            rows[number] = replace(rows[number], problem=answer.problem)
            errors.append(answer)
        else:
            ns = {quantity: answer[quantity] for quantity in request.quantities}
            rows[number] = replace(rows[number], ns=ns, total=ns[by] if by else sum(ns.values()))
    if errors and all(row.total is None for row in rows):
        raise errors[0]
    return tuple(rows)
