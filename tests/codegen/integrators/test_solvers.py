"""The solver of equilibria as C: no warning, no state, no undefined behaviour, no trace where unwanted."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.codegen.integrators.solvers import solver_spec
from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import SOLVER_STATUS, STATUS, Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import STRICT, check_object, check_sanitized, require_cpp, run, write_files
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.runtime.build import prism

HELD = {0: "xyz", 1: "xyz", 2: "xyz"}
PENDULUM = {
    "name": "pendulum",
    "gravity": [0.0, 0.0, -9.81],
    "model": {"solvers": ["equilibrium"]},
    "parameters": {"node_load": ["bar_B"], "rest_length": "all"},
    "bodies": {
        "base": {"kind": "fixed", "points": {"O": [0, 0, 0], "P": [1.0, 0, 0.2], "Q": [0, 1.0, 0.1]}},
        "bar": {
            "kind": "bar",
            "length": 0.7,
            "mass": 0.2,
            "anchor": "base.O",
            "elevation_deg": 40.0,
            "azimuth_deg": 45.0,
        },
    },
    "tendons": {
        "p": {"spring_constant": 90.0, "points": ["base.P", "bar.B"], "rest_length": 0.5},
        "q": {"spring_constant": 90.0, "points": ["base.Q", "bar.B"], "rest_length": 0.5},
    },
}


def of_nodes() -> GeneratedSource:
    request = ModelRequest(
        EQUILIBRIUM_QUANTITIES,
        parameters={"node_load": (3, 4), "rest_length": tuple(range(12)), "gravity": ()},
        solvers=("equilibrium",),
    )
    return emit(prism(anchored=HELD), request)


def of_bodies() -> GeneratedSource:
    system, request = assemble_scene(parse_scene(PENDULUM, "pendulum"), "pendulum")
    assert request.solvers == ("equilibrium",)
    wanted = request.wanting(*equilibrium_quantities(system, request), solvers=request.solvers)
    return emit(system, wanted)


def without_path() -> GeneratedSource:
    return emit(prism(anchored=HELD), ModelRequest(EQUILIBRIUM_QUANTITIES, solvers=("equilibrium",)))


SUBJECTS = {"nodes": of_nodes, "bodies": of_bodies, "baked": without_path}
each = pytest.mark.parametrize("subject", ["bodies", *thorough("nodes", "baked")])


@pytest.fixture(scope="module")
def sources() -> dict[str, GeneratedSource]:
    return {name: make() for name, make in SUBJECTS.items()}


@each
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_it_is_c99_without_a_warning(
    sources: dict[str, GeneratedSource], subject: str, family: str, tmp_path: Path
) -> None:
    compiler, source = require_compiler(family), sources[subject]
    folder = write_files(tmp_path / "source", source.files)
    options = ("-std=c99", *STRICT, "-Wshadow")
    run([*compiler.command, *options, "-c", f"{source.manifest.name}.c", "-o", "s.o"], folder, compiler)


@each
@pytest.mark.parametrize("family", ["g++", *thorough("clang++")])
def test_it_is_cpp11_without_a_warning(
    sources: dict[str, GeneratedSource], subject: str, family: str, tmp_path: Path
) -> None:
    command, source = require_cpp(family), sources[subject]
    folder = write_files(tmp_path / "source", source.files)
    options = ["-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
    run([*command, *options, "-c", f"{source.manifest.name}.c", "-o", "s.o"], folder)


@each
@pytest.mark.skipif(sys.platform != "linux", reason="reads the symbols of ELF objects")
def test_it_allocates_nothing_and_has_no_writable_data(
    sources: dict[str, GeneratedSource], subject: str, tmp_path: Path
) -> None:
    source = sources[subject]
    folder = write_files(tmp_path / "source", source.files)
    options = FLAG_SETS["reference"].options
    needed, exported = check_object(folder, f"{source.manifest.name}.c", *options)
    assert needed <= {"sqrt", "sin", "cos", "sincos", "fabs"}
    assert f"{source.manifest.name}_find_equilibrium" in exported
    assert all(symbol.startswith(f"{source.manifest.name}_") for symbol in exported)


def format_solver_driver(manifest: Manifest) -> str:
    """Return a program that calls the solver with good, bad and missing values, all arrays on the heap."""
    (spec,) = manifest.solvers
    name, large = manifest.name, manifest.name.upper()
    n = len(manifest.coordinate_name)
    nominal = [f"{name}_nominal_{argument}" for argument in spec.arguments]
    size = {item.name: len(item.nominal) for item in manifest.arguments}

    def one(arguments: list[str], place: str = "q", rest: str = "1e-9, 50, &r[0], w") -> str:
        given = ", ".join([place, *arguments, rest])
        return f"  reset(q); note({spec.symbol}({given}));"

    def path(arguments: list[str], count: str = "5", rest: str = "1e-9, 50, place, r, &found, w") -> str:
        given = ", ".join([f"{name}_nominal_coordinate, {count}", *arguments, rest])
        return f"  note({spec.symbol}_path({given}));"

    lines = [one(nominal), one(nominal, "NULL")]
    lines += [
        one(nominal, rest=rest)
        for rest in (
            "0.0, 50, &r[0], w", "NAN, 50, &r[0], w", "1e-9, -1, &r[0], w", "1e-9, 0, &r[0], w",
            "1e-300, 50, &r[0], w", "1e-9, 50, NULL, w", "1e-9, 50, &r[0], NULL",
        )
    ]  # fmt: skip
    lines += [one([*nominal[:k], "NULL", *nominal[k + 1 :]]) for k in range(len(nominal))]
    given = ", ".join(["q", *nominal, "1e-9, 50, &r[0], w"])
    lines += [f"  for (k = 0; k < {n}; ++k) q[k] = bad[b];", f"  note({spec.symbol}({given}));"]
    if spec.varied:
        place = spec.arguments.index(spec.varied)
        with_loads = [*nominal[:place], "loads", *nominal[place + 1 :]]
        lines += [
            path(with_loads),
            path(with_loads, "0"),
            path(with_loads, "-1"),
            path(with_loads, "LLONG_MIN"),
        ]
        lines += [
            path(with_loads, rest=f"1e-9, 50, {rest}")
            for rest in ("NULL, r, &found, w", "place, NULL, &found, w", "place, r, NULL, w")
        ]
        lines += [path([*with_loads[:place], "NULL", *with_loads[place + 1 :]])]
    count = size.get(spec.varied, 1)
    expected = ("OK", "NON_FINITE_INPUT", "INVALID_ARGUMENT", "NULL_POINTER", "NOT_CONVERGED")
    return f"""#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include "{name}.h"
static const double bad[] = {{NAN, INFINITY, -INFINITY, 0.0, 1e308, -1e308, 5e-324, 1.0, -3.0}};
static int worst = 0;
static int seen[{len(STATUS) + len(SOLVER_STATUS)}];
static void note(int status)
{{
  if (status < 0 || status >= {len(STATUS) + len(SOLVER_STATUS)}) {{ worst = 1; }}
  else {{ ++seen[status]; }}
}}
static void reset(double *q)
{{
  int k;
  for (k = 0; k < {n}; ++k) {{ q[k] = {name}_nominal_coordinate[k]; }}
}}
int main(void)
{{
  double *w = (double *)malloc({large}_EQUILIBRIUM_WORK * sizeof(double));
  double *q = (double *)malloc({n} * sizeof(double));
  double *place = (double *)malloc(5 * {n} * sizeof(double));
  double *loads = (double *)malloc(5 * {count} * sizeof(double));
  {name}_equilibrium_report *r = ({name}_equilibrium_report *)malloc(5 * sizeof(*r));
  long long found = 0;
  size_t b;
  int k;
  if (w == NULL || q == NULL || place == NULL || loads == NULL || r == NULL) {{ return 1; }}
  for (b = 0; b < sizeof bad / sizeof bad[0]; ++b) {{
    for (k = 0; k < 5 * {count}; ++k) {{ loads[k] = k < 3 * {count} ? 0.1 * k : bad[b]; }}
{chr(10).join("  " + line for line in lines)}
  }}
  (void)found;
  if ({" || ".join(f"seen[{large}_{word}] == 0" for word in expected)}) {{ worst = 1; }}
  free(w); free(q); free(place); free(loads); free(r);
  puts(worst ? "bad status" : "done");
  return worst;
}}
"""


@each
def test_no_sanitizer_has_anything_to_say(
    sources: dict[str, GeneratedSource], subject: str, tmp_path: Path
) -> None:
    source = sources[subject]
    driver = {"driver.c": format_solver_driver(source.manifest)}
    folder = write_files(tmp_path / "source", source.files | driver)
    check_sanitized(folder, "driver.c", f"{source.manifest.name}.c")


def test_manifest_and_header_say_what_the_solver_takes(sources: dict[str, GeneratedSource]) -> None:
    (spec,) = sources["nodes"].manifest.solvers
    assert spec.symbol == "small_find_equilibrium"
    assert spec.arguments == ("rest_length", "node_load", "gravity")
    assert spec.varied == "node_load"
    header = sources["nodes"].files["small.h"]
    assert f"SMALL_EQUILIBRIUM_WORK = {spec.work_size}" in header
    for value, word in enumerate(SOLVER_STATUS, len(STATUS)):
        assert f"SMALL_{word.upper()} = {value}" in header
    assert Manifest.from_json(sources["nodes"].manifest.to_json()) == sources["nodes"].manifest
    baked = sources["baked"]
    assert baked.manifest.solvers[0].varied == ""
    assert "_path(" not in baked.files["small.h"]


def test_a_scene_that_asks_for_no_solver_has_none() -> None:
    source = emit(prism(anchored=HELD), ModelRequest(EQUILIBRIUM_QUANTITIES))
    assert source.manifest.solvers == ()
    assert not any(
        "equilibrium_" in text for name, text in source.files.items() if name.endswith((".c", ".h"))
    )


def test_loads_without_a_potential_are_refused() -> None:
    turned = PENDULUM | {
        "inputs": [{"name": "twist", "kind": "torque", "bodies": ["bar"], "direction": [0.0, 0.0, 1.0]}]
    }
    system, request = assemble_scene(parse_scene(turned, "pendulum"), "pendulum")
    with pytest.raises(FormulationError, match="have no potential"):
        emit(system, request.wanting(*equilibrium_quantities(system, request), solvers=("equilibrium",)))


def test_an_unknown_solver_is_named() -> None:
    model = build_model(prism(anchored=HELD), ModelRequest(()))
    with pytest.raises(FormulationError, match="unknown solver") as caught:
        solver_spec(model, "newton", ())
    assert caught.value.given == "newton"


def test_rigid_bars_are_refused() -> None:
    structure = prism(anchored=HELD)
    rigid = structure.with_changes(
        spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant),
        rest_length=structure.member_length(),
    )
    quantities = ("potential_energy", "node_residual", "tangent_stiffness")
    with pytest.raises(FormulationError, match="no rigid bars"):
        emit(rigid, ModelRequest(quantities, formulation="rigid_bar", solvers=("equilibrium",)))
