"""What is refused names a way out, and whoever takes it is served."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import check_request
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.linear.linearize import linearize_quantities
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.table.long_structures import tower
from tests.runtime.build import bar, cable, make_structure, prism
from tests.test_golden import EXAMPLES

WANTED = (
    ("multiplier",),
    ("state_jacobian",),
    ("acceleration", "parameter_jacobian"),
    ("bar_distance",),
    ("support_reaction", "geometric_stiffness"),
    ("constraint_basis",),
    simulation_quantities("node_position"),
    linearize_quantities("node_distance", with_inputs=False),
)


def rigid(structure: Structure) -> Structure:
    return structure.with_changes(spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant))


def thick(structure: Structure) -> Structure:
    return structure.with_changes(radius=np.where(structure.is_bar, 0.01, 0.0))


def heavy(structure: Structure) -> Structure:
    return structure.with_changes(member_mass=np.where(structure.is_bar, 0.3, 0.0))


SMALL = thick(prism(anchored={0: "xyz"}))
BIG = tower(53)
STRUCTURES = {
    "small": SMALL,
    "small, rigid": rigid(SMALL),
    "big": BIG,
    "big, heavy bars": heavy(BIG),
    "big, rigid": rigid(BIG),
}


def follow(words: str, structure: Subject, request: ModelRequest) -> tuple[Subject, ModelRequest]:
    """Do what one part of a hint says."""
    if words.startswith("give the bars a stiffness"):
        assert isinstance(structure, Structure)
        mu = np.where(structure.is_rigid, 1e5, structure.spring_constant)
        structure = structure.with_changes(spring_constant=mu)
        request = replace(request, options={}, emitter="auto")
    if found := re.search(r'emitter = "(\w+)"', words):
        request = replace(request, emitter=found[1])
    if found := re.search(r'formulation = "(\w+)"', words):
        request = replace(request, formulation=found[1], options={}, emitter="auto")
    if found := re.search(r"options = \{ (\w+) = \"(\w+)\" \}", words):
        request = replace(request, options={found[1]: found[2]}, emitter="auto")
    if found := re.search(r"(?:which has no|leave out) ([\w, ]+)", words):
        dropped = found[1].split(", ")
        request = replace(request, quantities=tuple(q for q in request.quantities if q not in dropped))
    return structure, request


def hint_of(structure: Subject, request: ModelRequest) -> str:
    """Return the hint of a refusal, "" where there is none."""
    try:
        check_request(structure, request)
    except FormulationError as error:
        return error.hint
    return ""


@pytest.mark.parametrize("name", ["small", *thorough(*(name for name in STRUCTURES if name != "small"))])
@pytest.mark.parametrize("formulation", ["rigid_bar", *thorough("node_position", "node_distance")])
@pytest.mark.parametrize("emitter", ["auto", *thorough("unrolled", "table")])
def test_every_choice_that_a_hint_names_is_served(name: str, formulation: str, emitter: str) -> None:
    structure = STRUCTURES[name]
    followed = 0
    for wanted in WANTED:
        request = ModelRequest(wanted, {"rest_length": (0,)}, formulation=formulation, emitter=emitter)
        if "rigid" in name:
            request = replace(request, parameters={"rest_length": (1,)})
        for words in hint_of(structure, request).split("; or "):
            if re.search("emitter|formulation|options|leave out", words):
                check_request(*follow(words, structure, request))
                followed += 1
            else:
                assert re.match(
                    "a structure of at most 400|did you mean|known: |remove it from|give|$", words
                )
    assert followed or emitter == "auto" or name == "small"


@pytest.mark.thorough
def test_linearize_of_a_large_structure_with_heavy_bars_goes_round_in_no_circle() -> None:
    """Once: unrolled, said table, which said unrolled."""
    quantities = linearize_quantities("node_position", with_inputs=False)
    with pytest.raises(FormulationError) as caught:
        check_request(heavy(BIG), ModelRequest(quantities, emitter="unrolled"))
    assert caught.value.hint == 'emitter = "table"'
    plan = check_request(heavy(BIG), ModelRequest(quantities, emitter="auto"))
    assert plan.request.emitter == "table"


def test_a_quantity_of_another_formulation_is_told_where_it_is() -> None:
    with pytest.raises(FormulationError) as caught:
        check_request(SMALL, ModelRequest(("multiplier",)))
    assert 'formulation = "rigid_bar" with options = { bars = "all" }' in caught.value.hint


def test_a_second_fault_is_named_with_the_way_out() -> None:
    plain = rigid(prism(anchored={0: "xyz"}))
    with pytest.raises(FormulationError) as caught:
        check_request(plain, ModelRequest(("bar_distance",)))
    hint = (
        'formulation = "rigid_bar", and give the bars a radius [m]; contacts are of bars, not of rigid bodies'
    )
    assert caught.value.hint == hint


def test_bodies_above_400_tendons_are_refused_with_a_way_out() -> None:
    system, request = load_scene(next(path for path in EXAMPLES if path.stem == "svd_tower"))
    for emitter in ("auto", "unrolled", "table"):
        many = _Many(system)
        with pytest.raises(FormulationError) as caught:
            check_request(many, replace(request, emitter=emitter))  # type: ignore[arg-type]
        assert caught.value.hint == "a structure of at most 400 members"


class _Many:
    """A scene of bodies that says that it has 500 tendons; nothing else of it is looked at."""

    def __init__(self, system: Subject) -> None:
        self.system = system
        self.n_members = 500

    def __getattr__(self, name: str) -> object:
        return getattr(self.system, name)


def test_an_unknown_name_is_answered_with_the_nearest_first() -> None:
    known = [f"q{k}" for k in range(10)] + ["zebra_stiffness", "yak_stiffness", "total_energy", "mass_matrix"]
    text = suggest("stiff", known, most=3)
    assert text.startswith("known: 'yak_stiffness', 'zebra_stiffness'")
    assert text.endswith("and 11 more")


def test_loops_serve_a_row_of_rigid_bars_but_for_their_forces() -> None:
    place = [[float(k), 0, float(k % 2)] for k in range(450)]
    members = [bar(k, k + 1, 2**0.5, 0.0) if k % 3 == 0 else cable(k, k + 1, 1.0) for k in range(449)]
    row = make_structure(place, members, anchored={1: "xyz"})
    wanted = ("material_stiffness", "geometric_stiffness", "equilibrium_matrix")
    assert check_request(row, ModelRequest(wanted, formulation="rigid_bar", emitter="auto")).functions
    with pytest.raises(FormulationError) as caught:
        check_request(
            row, ModelRequest(("support_reaction", *wanted), formulation="rigid_bar", emitter="auto")
        )
    assert "leave out support_reaction" in caught.value.hint
