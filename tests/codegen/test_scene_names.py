"""Every name that a scene may have gives a library: nothing within the C takes a name of its interface."""

import re

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.scene.names import check_scene_name
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.request import ModelRequest
from tests.models import load
from tests.runtime.build import make_structure, spring


@pytest.fixture(scope="module")
def structure() -> Structure:
    return make_structure(
        [[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0, 40.0)], anchored={0: "xyz"}, mass=0.1, axes="x"
    )


@pytest.mark.parametrize("name", ["tower___final__2_", "a__b", "jac", "group0"])
def test_names_that_casadi_or_the_c_within_could_mind_give_a_library(structure: Structure, name: str) -> None:
    model = load(structure.with_changes(name=name), "member_tension")
    assert model.compute("member_tension") == pytest.approx([0.0])
    assert model.manifest.functions[0].symbol.startswith(f"{name}_")


@pytest.mark.parametrize("emitter", ["unrolled", "table"])
def test_nothing_within_is_named_like_the_interface_of_another_scene(
    structure: Structure, emitter: str
) -> None:
    quantities = (*SIMULATION_QUANTITIES, "node_residual", "tangent_stiffness", "potential_energy")
    request = ModelRequest(
        quantities,
        emitter=emitter,
        integrators=("rk4", "rk54", "radau"),
        solvers=("equilibrium",),
        batch_width=4,
        events=("condition",),
    )
    found = emit(structure.with_changes(name="qqq"), request, None).files
    text = " ".join(re.sub(r"/\*.*?\*/", "", found[f"qqq{end}"], flags=re.S) for end in (".c", ".h"))
    words = set(re.findall(r"(?<![.>\w])[A-Za-z]\w*", text))
    public = {word[4:] for word in words if word.startswith(("qqq_", "QQQ_"))}
    # of structs: names of their own
    fields = {"last_event", "stage_acceleration", "step_to_event", "time_to_event"}
    within = {word for word in words if not word.startswith(("qqq_", "QQQ_"))} - fields
    clashes = {word for word in within for end in public if word.endswith(f"_{end}")}
    assert clashes == set()


@pytest.mark.parametrize("name", ["example", "Example", "Makefile", "makefile", "GNUmakefile", "int", "_a"])
def test_names_of_files_beside_the_code_are_refused(structure: Structure, name: str) -> None:
    with pytest.raises(TensegrityError, match="name"):
        check_scene_name(name)


def test_a_scene_file_with_such_a_name_is_refused_where_it_is_read(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "s.toml"
    path.write_text('name = "example"\n[shape]\nkind = "prism"\n', encoding="utf-8")
    with pytest.raises(TensegrityError, match="beside the generated code"):
        load_scene(path)
