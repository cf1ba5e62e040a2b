"""Nonlinear programs with IPOPT: compiled functions find the optimum of the symbolic ones."""

import ctypes
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import casadi_external as programs
import numpy as np
import pytest

from tensegrity_codegen import load_scene, symbolic_functions
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.scene_functions import SymbolicFunctions
from tests.cases import thorough
from tests.codegen.build_c import run, write_files

STEPS = 50


@dataclass(frozen=True)
class Made:
    """One case: its symbolic functions, those of a library that counts calls, and the counters."""

    case: programs.Case
    symbolic: SymbolicFunctions
    compiled: Mapping[str, ca.Function]
    library: Path

    def calls(self) -> dict[str, int]:
        """Return how often each compiled function was called so far."""
        library = ctypes.CDLL(str(self.library))
        return {name: ctypes.c_longlong.in_dll(library, f"calls_{name}").value for name in self.names()}

    def names(self) -> list[str]:
        return re.findall(
            r"extern long long calls_(\w+)", (self.library.parent / "count.c").read_text(encoding="utf-8")
        )


@dataclass(frozen=True)
class Solved:
    """Both solutions of a case, and how often each compiled function was called."""

    made: Made
    found: programs.Solution
    expected: programs.Solution
    calls: Mapping[str, int]


@pytest.fixture(scope="module", params=[0, *thorough(1)])
def solved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Solved:
    made = make_case(request.param, tmp_path_factory.mktemp("programs"))
    found = solve(made, made.compiled)
    return Solved(made, found, solve(made, made.symbolic), made.calls())


def make_case(index: int, folder: Path) -> Made:
    case = programs.list_cases(folder)[index]
    structure, wanted = load_scene(case.scene)
    wanted = wanted.wanting(*case.quantities, parameters=case.parameters)
    made = emit(structure, replace(wanted, interfaces=("casadi_hessian",)))
    library = count_calls(write_files(folder / "source", made.files), structure.name, folder)
    symbolic = symbolic_functions(case.scene, quantities=case.quantities, parameters=case.parameters)
    compiled = {name: ca.external(f"{structure.name}_{name}", str(library)) for name in case.quantities}
    return Made(case, symbolic, compiled, library)


def count_calls(source: Path, name: str, folder: Path) -> Path:
    """Return a library of the same functions, each behind a counter of its calls."""
    text = (source / f"{name}.c").read_text(encoding="utf-8")
    found = re.findall(r"^\w+_API casadi_int (\w+)_n_in\(void\);", text, re.MULTILINE)
    signature = "(const double **arg, double **res, long long *iw, double *w, int mem)"
    wrap = [
        f"int real_{f}{signature};\nint {f}{signature};\n"
        f"extern long long calls_{f};\nlong long calls_{f} = 0;\n"
        f"int {f}{signature} {{ ++calls_{f}; return real_{f}(arg, res, iw, w, mem); }}\n"
        for f in found
    ]
    (folder / "count.c").write_text("\n".join(wrap), encoding="utf-8")
    compiler = find_compiler()
    renamed = [f"-D{f}=real_{f}" for f in found]
    options = ["-O0", "-ffp-contract=off", "-fPIC", f"-I{source}"]
    run(
        [*compiler.command, *options, *renamed, "-c", str(source / f"{name}.c"), "-o", "own.o"],
        folder,
        compiler,
    )
    run(
        [*compiler.command, *options, "-shared", "count.c", "own.o", "-o", "count.so", "-lm"],
        folder,
        compiler,
    )
    return folder / "count.so"


def solve(made: Made, functions: Mapping[str, ca.Function], **options: Any) -> programs.Solution:
    return programs.solve(lambda: made.case.make(functions, made.symbolic, None), **options)


def is_arm(solved: Solved) -> bool:
    return solved.made.case.name.startswith("arm")


def test_both_find_the_same_optimum(solved: Solved) -> None:
    for solution in (solved.found, solved.expected):
        assert solution.stats["return_status"] == "Solve_Succeeded"
    assert np.abs(solved.found.x - solved.expected.x).max() <= 1e-8
    assert solved.found.objective == pytest.approx(solved.expected.objective, rel=1e-8)


def test_no_derivative_is_a_finite_difference(solved: Solved) -> None:
    """Each evaluation of a program calls each function once a step, not once an unknown."""
    stats, calls = solved.found.stats, solved.calls
    evaluations = sum(stats[f"n_call_nlp_{what}"] for what in ("f", "g", "grad_f", "jac_g", "hess_l"))
    most = (STEPS if is_arm(solved) else 1) * (evaluations + 2)
    plain = {name: count for name, count in calls.items() if not name.startswith(("jac_", "adj1_"))}
    first = {name: count for name, count in calls.items() if re.match(r"jac_(?!adj1_)|adj1_", name)}
    second = {name: count for name, count in calls.items() if name.startswith("jac_adj1_")}
    assert 0 < max(plain.values()) <= most
    assert sum(first.values()) >= stats["n_call_nlp_jac_g"]
    assert 0 < max(second.values()) <= most


def test_the_optimum_is_what_was_asked_for(solved: Solved) -> None:
    x, symbolic = solved.found.x, solved.made.symbolic
    nominal, n = symbolic.nominal, len(symbolic.nominal["coordinate"])
    if is_arm(solved):
        tip = [symbolic.coordinate_name.index(f"{row}3_z") for row in "ab"]
        np.testing.assert_allclose(x[STEPS * n : (STEPS + 1) * n][tip] - x[:n][tip], 0.05, atol=1e-8)
        return
    q, u = x[:n], x[n:]
    assert np.abs(np.array(symbolic["node_residual"](q, u))).max() <= 1e-6
    assert np.array(symbolic["member_tension"](q, u))[3:].min() >= 1.0 - 1e-6
    place = [symbolic.coordinate_name.index(f"t1_{axis}") for axis in "xyz"]
    moved = q[place] - nominal["coordinate"][place].ravel()
    np.testing.assert_allclose(moved, [0.005, -0.005, 0.02], atol=1e-8)


def test_first_derivatives_are_enough_with_an_approximate_hessian(solved: Solved) -> None:
    if is_arm(solved):
        pytest.skip("the other program shows it")
    options = {"ipopt.hessian_approximation": "limited-memory", "ipopt.tol": 1e-8}
    found = solve(solved.made, solved.made.compiled, **options)
    assert found.stats["return_status"] == "Solve_Succeeded"
    assert found.objective == pytest.approx(solved.found.objective, rel=1e-5)
