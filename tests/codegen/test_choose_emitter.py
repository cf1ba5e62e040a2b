"""Which emitter `auto` chooses: the rule on cases, and the facts of scenes."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.codegen.choose_emitter import EmitterFacts, choose_emitter, find_facts
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.unrolled import MAX_MEMBERS
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import cable, make_structure, spring

AUTO = ModelRequest(("acceleration",), emitter="auto")


def chain(count: int, *, slack: bool = False) -> Structure:
    """`count` springs (or cables) in a row behind an anchor."""
    position = np.column_stack([np.arange(count + 1.0), np.zeros((count + 1, 2))])
    make = cable if slack else spring
    members = [make(k, k + 1, 0.9) for k in range(count)]
    return make_structure(position, members, anchored={0: "xyz"}, mass=np.ones(count + 1))


def chosen(structure: Subject, request: ModelRequest) -> str:
    return choose_emitter(find_facts(structure, request)).name


@pytest.mark.parametrize(
    ("facts", "name"),
    [
        (EmitterFacts("node_distance", 12), "unrolled"),
        (EmitterFacts("bodies", 5000), "unrolled"),
        (EmitterFacts("rigid_bar", 12), "unrolled"),
        (EmitterFacts("node_position", 12), "unrolled"),
        (EmitterFacts("node_position", 100), "unrolled"),
        (EmitterFacts("node_position", 101), "table"),
        (EmitterFacts("node_position", 101, lacking=("cable_margin",)), "unrolled"),
        (EmitterFacts("node_position", 400, lacking=("cable_margin",), most_members=400), "unrolled"),
        (EmitterFacts("node_position", 401, lacking=("cable_margin",), most_members=400), "table"),
        (EmitterFacts("node_position", 100_000), "table"),
    ],
)
def test_the_rule(facts: EmitterFacts, name: str) -> None:
    assert choose_emitter(facts).name == name


def test_the_reason_names_what_tables_do_not_serve() -> None:
    choice = choose_emitter(EmitterFacts("node_position", 200, lacking=("cable_margin", "input_jacobian")))
    assert "cable_margin, input_jacobian" in choice.why
    assert "200 members" in choice.why


def test_jacobians_to_parameters_and_contacts_need_the_unrolled_emitter() -> None:
    wanted = replace(AUTO, integrators=("rk54",))
    assert chosen(chain(120), wanted) == "table"
    assert chosen(chain(120, slack=True), wanted) == "table"
    assert chosen(chain(120, slack=True), replace(wanted, events=("contact",))) == "unrolled"
    assert chosen(chain(120, slack=True), replace(wanted, events=())) == "table"
    assert chosen(chain(120), replace(AUTO, integrators=("radau",))) == "table"
    assert chosen(chain(120), replace(AUTO, quantities=("parameter_jacobian",))) == "unrolled"
    pulled = chain(120).with_changes(inputs=(ActuatedInput("reel", "rest_length", (3, 4)),))
    assert chosen(pulled, replace(AUTO, quantities=("input_jacobian",))) == "table"


def test_what_only_tables_can_write_and_do_not_serve_is_refused_by_them() -> None:
    request = replace(AUTO, quantities=("parameter_jacobian",))
    with pytest.raises(FormulationError, match="'table'"):
        emit(chain(MAX_MEMBERS + 1), request)


def test_the_manifest_and_the_files_are_those_of_the_emitter_by_name() -> None:
    for structure, name in ((chain(2), "unrolled"), (chain(150), "table")):
        source = emit(structure, AUTO)
        assert source.manifest.emitter == name
        assert source.why_emitter == choose_emitter(find_facts(structure, AUTO)).why
        by_name = emit(structure, replace(AUTO, emitter=name))
        assert source.files == by_name.files
        assert by_name.why_emitter == "asked for by name"


def test_one_member_is_counted_in_the_singular() -> None:
    assert choose_emitter(find_facts(chain(1), AUTO)).why.startswith("1 member: ")
