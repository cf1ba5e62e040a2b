"""From values to arguments: exactly those of the edited scene, for every number of the example scenes."""

import pickle
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.read import read_document
from tensegrity_codegen.sweeps.apply.assembler import FileKey, build_assembler
from tensegrity_codegen.sweeps.apply.direct_keys import find_direct_keys
from tensegrity_codegen.sweeps.apply.group_cases import MOST_LIBRARIES, find_groups
from tensegrity_codegen.sweeps.cases.build_cases import build_cases
from tensegrity_codegen.sweeps.keys import KeyPath, find_numbers
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    TensegrityError,
    UnknownKeyError,
)
from tests.cases import thorough
from tests.sweeps.apply.exactly import EXAMPLES, group_and_compare


def scene(name: str) -> dict[str, Any]:
    return read_document(EXAMPLES / f"{name}.toml")


def sweep_number(name: str, path: str) -> None:
    document = scene(name)
    key = KeyPath.find(path, document)
    value = float(key.read(document) or 0.0)
    if key.bounds.is_whole:
        values = [value, value + 1, value + 2]
    else:
        values = [value * part for part in (1, 0.97, 1.04)] if value else [0.0, 0.1, -0.2]
    group_and_compare(document, build_cases({path: values}))


@pytest.mark.parametrize("name", ["planar", "two_nodes", *thorough("prism", "prism12")])
def test_every_number_of_a_small_example_can_vary(name: str) -> None:
    for path in find_numbers(scene(name)):
        sweep_number(name, path)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["icosahedron", "lin_prism", "pinned_prism", "svd_tower", "tower"])
def test_every_number_of_a_larger_example_can_vary(name: str) -> None:
    for path in find_numbers(scene(name)):
        sweep_number(name, path)


# Scene, keys with ranges, and the expected run-time parameters (of single libraries) or number of libraries.
MANY = [
    ("prism", ["loads[0].force[2]=-10:0:4", "gravity[2]=-9.81,0,-1.6"], {"node_load", "gravity"}),
    (
        "prism",
        ["classes.cable.spring_constant=100:400:3", "shape.prestress=5:20:3"],
        {"spring_constant", "rest_length"},
    ),
    ("prism", ["shape.bars=3,4,5", "loads[0].force[2]=-3,0"], 3),
    ("prism", ["nodes.t1.position[2]=0.25:0.35:3", "nodes.t2.velocity[0]=0,1"], 3),
    (
        "prism",
        ["members.vertical1.damping=0,0.5,1", "rest_length.top1=0.15:0.25:3"],
        {"damping", "rest_length"},
    ),
    (
        "prism",
        ["rest_length.vertical_cables=0.2:0.3:3", "node_mass.t1=0.1:0.2:2"],
        {"rest_length", "node_mass"},
    ),
    ("prism", ["node_velocity.t1[1]=-1,0,1", "node_position.t2[0]=0:0.1:3"], set()),
    ("prism", ["anchor_position.b1[2]=-0.01,0,0.01"], {"anchor_position"}),
    ("prism12", ["shape.twist=152:160:5", "input.v1=-0.01,0,0.01"], {"rest_length"}),
    ("prism12", ["shape.height=0.2:0.4:3", "shape.bottom_radius=0.1:0.2:3"], {"rest_length"}),
    (
        "planar",
        ["nodes.c.position[0]=0.5:0.7:3", "nodes.b.position[1]=-0.1,0"],
        {"rest_length", "anchor_position"},
    ),
    ("tower", ["gravity[2]=-9.81,0", "rest_length.saddle_cables=0.1:0.2:3"], {"rest_length", "gravity"}),
    ("pinned_prism", ["bodies.bar1.azimuth_deg=160:170:3", "input.t1=0,-0.01"], {"rest_length"}),
    ("svd_tower", ["bodies.top.centre[2]=1.0:1.2:3", "bodies.top.psi_rate_deg=0,5"], {"rest_length"}),
    ("svd_tower", ["velocity.top_x=0,0.1", "tendons.saddle1.damping=0,1"], {"damping", "rest_length"}),
    ("lin_prism", ["tendons.top1.rest_length=0.3:0.36:3", "gravity[2]=0,-9.81"], {"rest_length", "gravity"}),
]


@pytest.mark.parametrize(("name", "over", "expected"), MANY)
def test_several_keys_vary_together(name: str, over: list[str], expected: Any) -> None:
    groups = group_and_compare(scene(name), build_cases(over))
    if isinstance(expected, int):
        assert len(groups) == expected
    else:
        assert len(groups) == 1
        assert set(groups[0].request.parameters) == expected


@pytest.mark.parametrize(
    ("over", "n_libraries"),
    [
        ("gravity[2]=-9.81,-1.6", 1),  # the penetration gives the stiffness by the weight
        ("shape.node_mass=0.05,0.06", 1),
        ("ground.friction=0.1,0.2,0.3", 1),
        ("ground.friction=0,0.2", 2),
        ("ground.penetration=1e-4,2e-4", 1),
        ("ground.slope_deg=0,5", 2),
        ("loads[0].force[2]=-3,-1", 1),
        ("classes.cable.damping=0,1", 1),
    ],
)
def test_a_ground_follows_from_the_values_of_the_case(over: str, n_libraries: int) -> None:
    document = {**scene("prism"), "ground": {"penetration": 1e-4, "friction": 0.5, "offset": -0.1}}
    assert len(group_and_compare(document, build_cases([over]))) == n_libraries


@pytest.mark.parametrize("own", [{}, {"stick_damping": 3.0}, {"stick_stiffness": 1e4, "stick_damping": 3.0}])
@pytest.mark.parametrize("word", ["stiffness", "dissipation", "friction", "stick_stiffness", "stick_damping"])
def test_numbers_of_a_ground_change_what_follows_from_them(word: str, own: dict[str, float]) -> None:
    stated = {"stiffness": 2e4, "dissipation": 0.3, "friction": 0.5, "offset": -0.1}
    document = {**scene("prism"), "ground": {**stated, **own}}
    groups = group_and_compare(document, build_cases([f"ground.{word}=0.7,0.9,1.1"]))
    assert len(groups) == 1
    assert groups[0].request.parameters["ground"]


FORMULATIONS: list[tuple[str, dict[str, Any], list[str]]] = [
    ("prism12", {"formulation": "rigid_bar", "options": {"bars": "all"}}, ["shape.prestress=10,20"]),
    ("prism12", {"formulation": "rigid_bar", "options": {"bars": "all"}}, ["shape.height=0.3,0.31"]),
    ("prism12", {"formulation": "node_distance"}, ["shape.height=0.3,0.31", "shape.node_mass=0.05,0.06"]),
    ("planar", {"formulation": "node_distance"}, ["nodes.a.position[1]=0,0.01", "gravity[1]=-9.81,0"]),
]


@pytest.mark.parametrize(("name", "model", "over"), FORMULATIONS)
def test_other_formulations_have_the_arguments_of_the_edited_scene(
    name: str, model: dict[str, Any], over: list[str]
) -> None:
    document = scene(name)
    document["model"] = {**document.get("model", {}), **model}
    group_and_compare(document, build_cases(over))


def test_lengths_of_rigid_bars_are_constants_of_a_library() -> None:
    document = scene("prism12") | {"model": {"formulation": "rigid_bar", "options": {"bars": "all"}}}
    assert len(group_and_compare(document, build_cases(["shape.height=0.3,0.31"]))) == 2
    assert len(group_and_compare(document, build_cases(["node_position.t1[0]=0.1,0.11"]))) == 2
    assert len(group_and_compare(document, build_cases(["gravity[2]=0,-1"]))) == 1


def test_samples_and_tables_are_applied_exactly_too() -> None:
    sample = {"shape.prestress": "uniform(5,15)", "loads[0].force[2]": "normal(-3,1)"}
    group_and_compare(scene("prism"), build_cases({}, sample, n=40, method="sobol"))
    table = {"gravity[0]": [0.0, 1.0, 2.0], "classes.cable.spring_constant": [100.0, 200.0, 150.0]}
    group_and_compare(scene("prism"), build_cases(table=table))


def test_rest_lengths_follow_by_formulas_also_where_nodes_start_elsewhere() -> None:
    cases = build_cases(["shape.prestress=8:12:3", "node_position.t1[2]=0.29,0.31"])
    (group,) = group_and_compare(scene("prism"), cases)
    assert group.mapper.direct.rest_lengths is not None
    assert not group.mapper.indirect_keys


DIRECT = {
    "prism": [
        *("gravity[2]", "loads[0].force[2]", "shape.prestress", "shape.node_mass", "node_load.t2[0]"),
        *("classes.cable.spring_constant", "classes.cable.damping", "node_velocity.t1[1]", "node_mass.t1"),
        *("rest_length.vertical_cables", "node_position.t1[2]", "anchor_position.b1[2]"),
    ],
    "planar": ["nodes.c.velocity[0]", "nodes.c.mass", "classes.post.prestress"],
    "prism12": ["input.v1"],
    "lin_prism": ["gravity[2]", "tendons.top1.rest_length"],
}


@pytest.mark.parametrize("name", DIRECT)
def test_keys_that_name_entries_need_no_assembly(name: str) -> None:
    document = scene(name)
    assembler = build_assembler(document, DIRECT[name])
    paths = [key.path if isinstance(key, FileKey) else None for key in assembler.keys]
    values = np.array([(path and path.read(document)) or 1.0 for path in paths], dtype=float)
    case = assembler.assemble(values)
    found = find_direct_keys(case, assembler.keys, values, range(len(values)))
    assert found.keys == set(range(len(values)))


def test_loads_on_one_node_add_up() -> None:
    document = scene("prism")
    document["loads"].append({"node": "t1", "force": [0.1, 0.0, 0.7]})
    group_and_compare(document, build_cases(["loads[0].force[2]=-10:0:7"]))
    group_and_compare(document, build_cases(["loads[0].force[2]=-10:0:3", "loads[1].force[2]=-1:0:3"]))
    document["loads"][0]["node"] = "t*"
    group_and_compare(document, build_cases(["loads[0].force[2]=-10:0:3", "loads[1].force[2]=-1:0:3"]))


def test_a_structure_far_away_with_renamed_nodes_is_applied_exactly() -> None:
    document = {
        "name": "far",
        "classes": {"rope": {"kind": "cable", "axial_stiffness": 1e4, "strain": 0.01}},
        "nodes": {
            "zeta": {"position": [1000.0, -1000.0, 1000.0], "anchored": True},
            "alpha": {"position": [1000.0, -1000.0, 999.0], "mass": 2.0},
            "mid": {"position": [1001.0, -1000.0, 1000.0], "anchored": "xyz"},
        },
        "members": {
            "z1": {"class": "rope", "nodes": ["alpha", "zeta"]},
            "a9": {"class": "rope", "nodes": ["mid", "alpha"], "switch_force": 50.0, "stiffness_ratio": 0.5},
        },
    }
    over = ["nodes.alpha.position[2]=998:999.5:4", "classes.rope.strain=0.01:0.02:3", "nodes.alpha.mass=1,2"]
    groups = group_and_compare(document, build_cases(over))
    assert sum(len(group.rows) for group in groups) == 24


def test_cases_that_are_no_scene_get_a_message_and_the_others_their_arguments() -> None:
    cases = build_cases(["classes.cable.spring_constant=-100,100,200,0", "loads[0].force[2]=-1,0"])
    (group,) = group_and_compare(scene("prism"), cases)
    applied = group.arguments(cases.values())
    assert applied.good.tolist() == [False, False, True, True, True, True, False, False]
    assert "spring_constant" in applied.messages[0]
    assert np.isfinite(applied.arguments["rest_length"][2:6]).all()


def test_cases_that_fail_only_together_get_a_message() -> None:
    # A prestress is possible up to spring_constant * length.
    cases = build_cases(["classes.cable.spring_constant=20:200:7", "shape.prestress=1:30:7"])
    (group,) = group_and_compare(scene("prism"), cases)
    good = group.arguments(cases.values()).good
    assert 0 < good.sum() < cases.count


@pytest.mark.thorough
def test_normal_tails_outside_the_allowed_numbers_are_single_bad_cases() -> None:
    cases = build_cases({}, {"classes.cable.damping": "normal(0.1,0.1)"}, n=300, seed=1)
    (group,) = group_and_compare(scene("prism"), cases)
    assert not group.mapper.assembles_all
    assert group.arguments(cases.values()).good.tolist() == (cases.values()[:, 0] >= 0).tolist()


def test_a_sweep_without_a_good_case_raises_the_first_error() -> None:
    with pytest.raises(InvalidValueError, match="no case of the sweep is a scene"):
        group_and_compare(scene("prism"), build_cases(["shape.height=-2,-1,0"]))


def test_codes_that_no_case_can_have_are_bad_cases_of_a_group() -> None:
    cases = build_cases(["shape.bars=2,3,4,4.5", "loads[0].force[2]=-1,0"])
    groups = group_and_compare(scene("prism"), cases)
    assert len(groups) == 2
    assert sum(int(g.arguments(cases.select(np.asarray(g.rows))).good.sum()) for g in groups) == 4


def test_results_do_not_depend_on_how_cases_are_divided() -> None:
    cases = build_cases({}, {"shape.prestress": "uniform(5,15)", "gravity[2]": "normal(-9,1)"}, n=60)
    (group,) = find_groups(build_assembler(scene("prism"), cases.keys), cases)
    whole = pickle.loads(pickle.dumps(group)).arguments(cases.values()).arguments
    for first in range(0, 60, 7):
        part = group.arguments(cases.values(first, min(first + 7, 60))).arguments
        for name, array in part.items():
            assert np.array_equal(array, whole[name][first : first + 7])


def test_many_libraries_need_an_express_yes() -> None:
    cases = build_cases({"classes.bar.density": np.linspace(1000, 2000, MOST_LIBRARIES + 1)})
    assembler = build_assembler(scene("prism"), cases.keys)
    with pytest.raises(
        InvalidValueError, match=r"classes.bar.density, since member_mass cannot change"
    ) as caught:
        find_groups(assembler, cases, option="--yes")
    assert "more than 50 libraries" in str(caught.value)
    assert "--yes" in str(caught.value)
    assert len(find_groups(assembler, cases, yes=True)) == MOST_LIBRARIES + 1


def test_a_length_that_changes_the_masses_of_bars_is_explained() -> None:
    cases = build_cases({}, {"shape.height": "uniform(0.28,0.32)"}, n=2000)
    with pytest.raises(InvalidValueError, match="since member_mass cannot change at run time") as caught:
        find_groups(build_assembler(scene("prism"), cases.keys), cases, option="--yes")
    assert "a mass in place of a density" in str(caught.value)
    assert "more than 50 libraries" in str(caught.value)
    assert "--yes" in str(caught.value)
    document = scene("prism")
    document["classes"]["bar"] = {"kind": "bar", "spring_constant": 2e5, "mass": 0.02}
    assert len(find_groups(build_assembler(document, cases.keys), cases)) == 1


@pytest.mark.parametrize(
    ("name", "keys", "error", "words"),
    [
        ("prism", ["rest_length.vertical9"], UnknownKeyError, "vertical1"),
        ("prism", ["rest_length"], UnknownKeyError, "rest_length.NAME"),
        ("prism", ["rest_length.vertical1[0]"], InvalidValueError, "rest_length.vertical1"),
        ("prism", ["node_load.t1"], InvalidValueError, "[0], [1] or [2]"),
        ("prism", ["node_load.t1[3]"], InvalidValueError, "[0], [1] or [2]"),
        ("prism", ["axial_stiffness.vertical1"], InvalidValueError, "no axial_stiffness"),
        ("prism", ["node_velocity.b1[2]"], InvalidValueError, "cannot move"),
        ("planar", ["node_load.c[1]"], InvalidValueError, "cannot move or be loaded"),
        ("prism", ["coordinate.x"], InvalidValueError, "no such values"),
        ("svd_tower", ["node_mass.top_centre"], InvalidValueError, "no such values"),
        ("prism12", ["input.v9"], UnknownKeyError, "v1"),
        ("prism", ["input.v1"], TensegrityError, "prism"),
        ("prism", ["nodes.t9.position[0]"], UnknownKeyError, "t1"),
        ("prism12", ["actuators.v1.rate", "actuators[0].rate"], DuplicateNameError, "same number"),
        ("prism", ["shape.hieght"], UnknownKeyError, "height"),
    ],
)
def test_wrong_keys_are_named_errors(
    name: str, keys: list[str], error: type[TensegrityError], words: str
) -> None:
    with pytest.raises(error) as caught:
        build_assembler(EXAMPLES / f"{name}.toml", keys)
    assert words in str(caught.value)
    assert "toml" in str(caught.value)


def test_a_wrong_column_is_an_error_that_names_the_table() -> None:
    with pytest.raises(UnknownKeyError, match=r"^cases.csv: line 1: column shape.hieght"):
        build_assembler(scene("prism"), ["shape.hieght"], source="cases.csv: line 1")


def test_cables_in_segments_are_assembled_for_each_case() -> None:
    ends = {"position": [0, 0], "anchored": True}
    document = {
        "name": "span", "axes": "xz", "gravity": [0, -10],
        "nodes": {"a": ends, "b": {**ends, "position": [10, 0]}, "c": {"position": [5, -2], "mass": 3.0}},
        "classes": {"rope": {"kind": "cable", "mass": 0.4, "spring_constant": 50.0, "segments": 3}},
        "members": {"ac": {"class": "rope", "nodes": ["a", "c"], "prestress": 3.0},
                    "bc": {"class": "rope", "nodes": ["b", "c"], "segments": 1}},
    }  # fmt: skip
    keys = ["classes.rope.spring_constant=40,60", "members.ac.prestress=2,4", "nodes.c.position[0]=5,5.1"]
    (group,) = group_and_compare(document, build_cases([*keys, "nodes.c.mass=2,3", "gravity[1]=-10,-8"]))
    assert group.request.parameters.keys() >= {"spring_constant", "rest_length", "gravity", "node_mass"}
    assert len(group_and_compare(document, build_cases(["classes.rope.segments=2,3"]))) == 2
    document["classes"]["rope"] |= {"mass_per_length": 0.1}
    del document["classes"]["rope"]["mass"]
    assert len(group_and_compare(document, build_cases(["members.ac.prestress=2,4"]))) == 2  # masses differ


def test_gains_of_temperature_follow_rest_lengths() -> None:
    document = scene("prism")
    document["classes"]["cable"]["thermal_expansion"] = 1e-4
    document["inputs"] = [{"kind": "temperature", "name": "sun", "members": ["cable"]}]
    groups = group_and_compare(document, build_cases(["shape.prestress=5:20:3", "input.sun=0,40"]))
    assert [len(group.rows) for group in groups] == [2, 2, 2]  # one library for each set of rest lengths
    groups = group_and_compare(document, build_cases(["loads[0].force[2]=-5:-1:3", "input.sun=0,40"]))
    assert len(groups) == 1
