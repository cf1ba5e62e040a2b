"""Import of NTRT files: placing of substructures, builders, rigid bodies, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.import_ntrt import import_ntrt
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.symbolic.rigid_bar_check import check_formulation
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    UnknownKeyError,
    UnknownNameError,
)

SHARED = Path(__file__).parents[4] / "shared" / "data" / "ntrt"
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the toolkit's files are not beside the project"
)

STICK = """
nodes:
  low: [0, 0, 0]
  high: [0, 2, 0]
pair_groups:
  rod:
    - [low, high]
"""
PAIR = """
substructures:
  a/b/c:
    path: stick.yaml
    offset: [1, 0, 0]
bond_groups:
  string:
    a/b/c/node_node:
      - [low, low]
      - [low, high]
builders:
  string:
    class: tgBasicActuatorInfo
    parameters: {stiffness: 50, damping: 2, pretension: 10, history: 1}
  rod:
    class: tgRodInfo
    parameters: {density: 0.5, radius: 0.1}
"""


@pytest.fixture
def load(tmp_path):
    def load(main=PAIR, stick=STICK, **options):
        (tmp_path / "stick.yaml").write_text(stick)
        (tmp_path / "main.yaml").write_text(main)
        return import_ntrt(tmp_path / "main.yaml", **options)

    return load


def positions(document):
    return {name: node["position"] for name, node in document["nodes"].items()}


def test_chain_of_substructures(load):
    document = load().document
    assert positions(document) == {
        "a_low": [0, 0, 0],
        "a_high": [0, 2, 0],
        "b_low": [1, 0, 0],
        "b_high": [1, 2, 0],
        "c_low": [2, 0, 0],
        "c_high": [2, 2, 0],
    }
    members = document["members"]
    assert list(members) == [
        *("a_rod_1", "b_rod_1", "c_rod_1"),
        *("string_a_b_1", "string_a_b_2", "string_b_c_1", "string_b_c_2"),
    ]
    assert members["string_a_b_2"]["nodes"] == ["a_low", "b_high"]
    assert members["string_a_b_2"]["rest_length"] == math.sqrt(5) - 10 / 50
    assert document["classes"] == {
        "rod": {"kind": "bar", "spring_constant": 50000.0, "density": 0.5, "radius": 0.1},
        "string": {"kind": "cable", "spring_constant": 50.0, "damping": 2.0},
    }


def test_mass_stiffness_and_notes(load):
    result = load(bar_stiffness_ratio=200.0, gravity=(0, -9.81, 0), name="sticks")
    structure, _ = assemble(parse_scene(result.document))
    assert structure.name == "sticks"
    assert structure.gravity.tolist() == [0, -9.81, 0]
    assert structure.member_mass[:3] == pytest.approx([0.5 * math.pi * 0.01 * 2] * 3)
    assert structure.spring_constant.tolist() == [1e4] * 3 + [50.0] * 4
    assert any("200 times" in note for note in result.notes)
    assert any("history" in note for note in result.notes)


def test_import_is_deterministic(load):
    assert load() == load()


def test_length_scale_keeps_mass_and_stiffness(load):
    one, _ = assemble(parse_scene(load().document))
    tenth, _ = assemble(parse_scene(load(length_scale=0.1).document))
    assert np.allclose(tenth.node_position, 0.1 * one.node_position)
    assert np.allclose(tenth.rest_length, 0.1 * one.rest_length)
    assert np.allclose(tenth.member_mass, one.member_mass)
    assert np.allclose(tenth.spring_constant, one.spring_constant)
    assert np.allclose(tenth.radius, 0.1 * one.radius)


def place(load, attributes):
    bond = "string: {a/b/node_node: [[low, low], [high, high]]}"
    children = f"a: {{path: stick.yaml}}, b: {{path: stick.yaml, {attributes}}}"
    main = f"substructures: {{{children}}}\nbond_groups: {{{bond}}}\n"
    found = positions(load(main).document)
    return found["b_low"], found["b_high"]


@pytest.mark.parametrize(
    ("attributes", "low", "high"),
    [
        ("translation: [3, 0, 1]", [3, 0, 1], [3, 2, 1]),
        ("offset: [3, 0, 1], translation: [1, 0, 0]", [1, 0, 0], [1, 2, 0]),  # the first child has place 0
        ("scale: 0.5, translation: [1, 0, 0]", [1, 0.5, 0], [1, 1.5, 0]),  # about the centroid
        ("rotation: {axis: [0, 0, 2], angle: 90}", [1, 1, 0], [-1, 1, 0]),  # about the centroid
        (
            "rotation: {axis: [0, 0, 1], angle: 90, reference: [0, 0, 0]}, translation: [0, 0, 1]",
            [0, 0, 1],
            [-2, 0, 1],
        ),
        ("rotation: {axis: [1, 0, 0], angle: 90, reference: [1, 0, 0]}, scale: 2", [0, 0, -1], [0, 0, 3]),
    ],
)
def test_placing(load, attributes, low, high):
    found = place(load, attributes)
    assert found[0] == pytest.approx(low, abs=1e-15)
    assert found[1] == pytest.approx(high, abs=1e-15)


def test_one_child_may_stand_in_several_keys(load):
    main = (
        "substructures:\n  a/b: {path: stick.yaml}\n  b/a: {offset: [0, 0, 5]}\n"
        "  b: {translation: [1, 0, 0]}\n"
        "bond_groups: {a/b/node_node: {string: [[low, low]]}}\n"
    )
    found = positions(load(main).document)
    assert found["a_low"] == [0, 0, 5]
    assert found["b_low"] == [1, 0, 0]


def test_nodes_below_children_by_path_and_by_search(tmp_path, load):
    (tmp_path / "two.yaml").write_text("substructures:\n  a/b: {path: stick.yaml, offset: [1, 0, 0]}\n")
    main = (
        "substructures:\n  left/right: {path: two.yaml, offset: [4, 0, 0]}\n"
        "bond_groups: {string: {left/right/node_node: [[b.low, a.low], [high, b.high]]}}\n"
        "pair_groups: {string: [[left.a.low, left.b.low]]}\n"
    )
    document = load(main).document
    assert document["members"]["string_left_right_1"]["nodes"] == ["left_b_low", "right_a_low"]
    assert document["members"]["string_left_right_2"]["nodes"] == ["left_a_high", "right_b_high"]
    assert document["members"]["string_1"]["nodes"] == ["left_a_low", "left_b_low"]
    assert positions(document)["right_b_low"] == [5, 0, 0]


def test_the_outermost_builder_counts_and_tags_add_up(load):
    stick = STICK + "builders: {rod: {class: tgRodInfo, parameters: {radius: 9}}}\n"
    main = PAIR + "  string b/c: {class: tgBasicActuatorInfo, parameters: {stiffness: 70}}\n"
    document = load(main, stick).document
    assert document["classes"]["rod"]["radius"] == 0.1
    assert document["members"]["string_a_b_1"]["class"] == "string"
    assert document["members"]["string_b_c_1"]["class"] == "string_b_c"
    assert document["classes"]["string_b_c"]["spring_constant"] == 70.0
    assert document["classes"]["rod"]["spring_constant"] == 70000.0


def test_default_builders(load):
    main = PAIR[: PAIR.index("builders")]
    classes = load(main).document["classes"]
    assert classes["rod"] == {"kind": "bar", "spring_constant": 1e6, "density": 1.0, "radius": 0.5}
    assert classes["string"] == {"kind": "cable", "spring_constant": 1000.0, "damping": 10.0}


STAR = """
nodes: {o: [0, 0, 0], x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], lone: [9, 9, 9], p: [3, 0, 0], q: [3, 1, 0]}
pair_groups:
  rod: [[o, x], [o, y], [o, z], [p, q]]
  string: [[x, p], [y, q], [x, y], [z, p]]
  nothing: [[x, q]]
"""


def test_rods_that_share_nodes_are_braced(load):
    result = load(STAR)
    members = result.document["members"]
    braces = [set(member["nodes"]) for member in members.values() if member["class"] == "brace"]
    assert braces == [{"x", "y"}, {"x", "z"}, {"y", "z"}]
    assert result.document["classes"]["brace"] == {"kind": "bar", "spring_constant": 1e6}
    assert {"x", "y"} not in [set(m["nodes"]) for m in members.values() if m["class"] == "string"]
    assert "lone" not in result.document["nodes"]
    text = "\n".join(result.notes)
    for part in (
        "3 massless bracing bars",
        "1 cable between points of one",
        "1 node of no rod or cable",
        "1 pair without a builder",
    ):
        assert part in text
    structure, _ = assemble(parse_scene(result.document))
    assert structure.member_mass.sum() == pytest.approx(4 * math.pi * 0.25)


def test_flat_bodies_are_noted(load):
    notes = load(STAR.replace("z: [0, 0, 1]", "z: [1, 1, 0]")).notes
    assert any("lie in a plane" in note for note in notes)


def test_nodes_at_one_place_are_one(load):
    main = (
        "substructures:\n  a: {path: stick.yaml}\n  b: {path: stick.yaml, translation: [0, 2, 0]}\n"
        "  c: {path: stick.yaml, translation: [5, 0, 0]}\n"
        "bond_groups: {string: {b/c/node_node: [[high, high]]}}\n"
    )
    result = load(main)
    assert list(result.document["nodes"]) == ["a_low", "a_high", "b_high", "c_low", "c_high"]
    assert result.document["members"]["b_rod_1"]["nodes"] == ["a_high", "b_high"]
    assert any("exactly on another" in note for note in result.notes)


def test_bodies_without_mass_stand_still(load):
    main = PAIR.replace("density: 0.5", "density: 0")
    result = load(main)
    assert all(node["anchored"] is True for node in result.document["nodes"].values())
    assert any("stand still" in note for note in result.notes)


def test_texts_stay_texts(load):
    main = "nodes: {no: [0, 0, 0], 1e3: [1.e0, 0x, 0]}\n".replace("0x", "010")
    result = load(main + "pair_groups: {rod: [[no, 1e3]]}\n")
    assert positions(result.document) == {"no": [0, 0, 0], "n1e3": [1, 10, 0]}
    assert any("'1e3' is n1e3" in note for note in result.notes)
    assert any("bars are rigid" in note for note in result.notes)


@pytest.mark.parametrize(
    ("main", "error", "text"),
    [
        ("nodes: [", SceneSyntaxError, "not valid YAML"),
        ("", SceneSyntaxError, "empty"),
        ("[" * 5000 + "]" * 5000, SceneSyntaxError, "nest"),  # PyYAML 6.0.4 has a limit of its own
        ("a: &a [*a]", SceneSyntaxError, "not valid YAML"),
        ("nodes: {a: [0, 0, 0], a: [1, 0, 0]}", DuplicateNameError, "'a'"),
        ("? [1]\n: 2", DuplicateNameError, "not a text"),
        ("- 1", InvalidValueError, "not a table"),
        ("nods: {}", UnknownKeyError, "nodes"),
        ("nodes: {}", StructureError, "no rod and no cable"),
        ("nodes: !!python/object/apply:os.getcwd []", InvalidValueError, "not a table"),
        (STAR.replace("z: [0, 0, 1]", "z: [0, 0]"), InvalidValueError, "nodes.z"),
        (STAR.replace("z: [0, 0, 1]", "z: [0, 0, up]"), InvalidValueError, "'up'"),
        (STAR.replace("z: [0, 0, 1]", "z: [0, 0, .inf]"), NonFiniteError, "nodes.z"),
        (STAR.replace("[o, x]", "[o, w]"), UnknownNameError, "pair_groups.rod[0]"),
        (STAR.replace("[o, x]", "[o, x, y]"), InvalidValueError, "pair of nodes"),
        (STAR.replace("[o, x]", "[o, o]"), StructureError, "itself"),
        (STAR.replace("[z, p]", "[p, x]"), DuplicateNameError, "same two points"),
        (STAR.replace("[z, p]", "[z, lone]"), StructureError, "no rod is"),
        (STAR.replace("string:", "box:"), InvalidValueError, "tgBoxInfo"),
        (
            PAIR.replace("pretension: 10", "pretension: 50"),
            InvalidValueError,
            "shortens the cable to nothing",
        ),
        (PAIR.replace("stiffness: 50", "stiffness: 0"), InvalidValueError, "parameters.stiffness"),
        (PAIR.replace("damping: 2", "damping: -2"), InvalidValueError, "parameters.damping"),
        (PAIR.replace("radius: 0.1", "radius: 0"), InvalidValueError, "parameters.radius"),
        (PAIR.replace("history", "histery"), UnknownKeyError, "'history'"),
        (PAIR.replace("tgRodInfo", "tgMeshInfo"), InvalidValueError, "tgRodInfo"),
        (PAIR.replace("stick.yaml", "none.yaml"), SceneError, "none.yaml"),
        (PAIR.replace("stick.yaml", "/etc/stick.yaml"), InvalidValueError, "relative path"),
        (PAIR.replace("stick.yaml", "stick.txt"), SceneError, "no YAML file"),
        (PAIR.replace("stick.yaml", "main.yaml"), StructureError, "substructure of itself"),
        (PAIR.replace("a/b/c:", "a/b/a:"), DuplicateNameError, "'a'"),
        (PAIR.replace("a/b/c:", "a//c:"), InvalidValueError, "a//c"),
        (PAIR.replace("a/b/c/node_node", "a/b/d/node_node"), UnknownNameError, "'d'"),
        (PAIR.replace("node_node", "node_edge"), InvalidValueError, "three"),
        (PAIR.replace("node_node", "node_face"), InvalidValueError, "node_edge"),
        (PAIR.replace("a/b/c/node_node", "a/node_node"), InvalidValueError, "not a bond"),
        (PAIR.replace("a/b/c/node_node", "nested"), InvalidValueError, "not nested"),
        (PAIR.replace("offset: [1, 0, 0]", "scale: 0"), InvalidValueError, "scale"),
        (PAIR.replace("offset: [1, 0, 0]", "rotation: {angle: 90}"), InvalidValueError, "axis"),
        (PAIR.replace("offset", "ofset"), UnknownKeyError, "offset"),
    ],
)
def test_bad_files(load, main, error, text):
    with pytest.raises(error) as caught:
        load(main)
    assert text in str(caught.value)
    assert "yaml" in caught.value.where


def test_multiplying_substructures_are_refused(tmp_path, load):
    names = "/".join(f"s{i}" for i in range(30))
    for level in range(3):
        below = "stick.yaml" if level == 0 else f"level{level - 1}.yaml"
        (tmp_path / f"level{level}.yaml").write_text(f"substructures:\n  {names}: {{path: {below}}}\n")
    with pytest.raises(StructureError, match="multiply"):
        load("substructures:\n  a: {path: level2.yaml}\n")


def test_size_and_values(tmp_path, load):
    with pytest.raises(SceneSyntaxError, match="too large"):
        load("x" * 2_000_000)
    with pytest.raises(SceneError, match="cannot be read"):
        import_ntrt(tmp_path / "none.yaml")
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(InvalidValueError):
            load(length_scale=bad)
        with pytest.raises(InvalidValueError):
            load(bar_stiffness_ratio=bad)


@needs_shared
@pytest.mark.parametrize(
    ("file", "n_nodes", "n_bars", "n_braces", "n_cables"),
    [
        ("BaseStructures/3Prism.yaml", 6, 3, 0, 9),
        ("BaseStructures/SuperBall.yaml", 12, 6, 0, 24),
        ("Spines/TetrahedralSpine.yaml", 30, 24, 36, 40),
    ],
)
def test_files_of_the_toolkit(file, n_nodes, n_bars, n_braces, n_cables):
    document = import_ntrt(SHARED / file).document
    structure, _ = assemble(parse_scene(document))
    assert structure.n_nodes == n_nodes
    assert structure.member_class.count("brace") == n_braces
    assert (structure.is_bar.sum(), (~structure.is_bar).sum()) == (n_bars + n_braces, n_cables)


@needs_shared
def test_the_spine_is_offset_module_by_module():
    document = import_ntrt(SHARED / "Spines" / "TetrahedralSpine.yaml").document
    assert positions(document)["t6_front"] == [10, 20, 10 - 5 * 12]
    assert document["members"]["string_t5_t6_5"]["nodes"] == ["t5_right", "t6_front"]
    assert document["members"]["string_t1_t2_1"]["rest_length"] == pytest.approx(12.0)


def rigid_names(document):
    """Return the members that have no stiffness of their own and none of their class."""
    classes, members = document["classes"], document["members"]
    return [name for name, m in members.items() if "spring_constant" not in {**classes[m["class"]], **m}]


BODY = """
nodes: {o: [0, 0, 0], x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], w: [-1, -1, -1]}
pair_groups:
  rod: [[o, x], [o, y], [o, z], [o, w]]
"""


@pytest.mark.parametrize(
    ("body", "n_rigid", "n_springs"),
    [
        (BODY, 9, 0),  # 3 * 5 - 6
        (BODY.replace("w: [-1, -1, -1]", "w: [1, 1, 1]"), 9, 0),
        (BODY.replace("[o, w]]", "[o, w], [x, y], [y, z], [z, x], [x, w], [y, w], [z, w]]"), 9, 1),
        (
            BODY.replace("z: [0, 0, 1], w: [-1, -1, -1]", "z: [1, 1, 0], w: [-1, 2, 0]"),
            7,
            0,
        ),  # flat: 2 * 5 - 3
        (BODY.replace("[o, w]]", "[w, z]]"), 9, 0),
    ],
)
def test_one_body_alone_is_a_scene_that_passes_the_checks(load, body, n_rigid, n_springs):
    result = load(body)
    structure, request = assemble(parse_scene(result.document))
    check_formulation(structure, request)
    assert request.formulation == "rigid_bar"
    assert len(rigid_names(result.document)) == n_rigid
    assert structure.n_members == n_rigid + n_springs
    place = structure.node_position
    rigid = structure.connectivity[structure.is_rigid]
    rows = np.zeros((len(rigid), *place.shape))
    for row, (i, j) in enumerate(rigid):
        rows[row, i], rows[row, j] = place[i] - place[j], place[j] - place[i]
    assert np.linalg.matrix_rank(rows.reshape(len(rigid), -1)) == n_rigid


def test_rods_are_rigid_on_request(load):
    result = load(STAR, rigid=True)
    structure, request = assemble(parse_scene(result.document))
    check_formulation(structure, request)
    assert request.formulation == "rigid_bar"
    assert len(rigid_names(result.document)) == 4 + 3
    assert "brace" not in load(PAIR, rigid=True).document["classes"]
    assert any("rigid bars, as in the toolkit" in note for note in result.notes)


def test_rods_without_mass_are_anchored_and_need_no_rigid_bar(load):
    main = PAIR.replace("density: 0.5", "density: 0") + "  rod a: {class: tgRodInfo}\n"
    structure, request = assemble(parse_scene(load(main, rigid=True).document))
    check_formulation(structure, request)
    assert structure.is_rigid.sum() == 1
    assert structure.node_anchored.all(axis=1).sum() == 4


def test_a_sphere_is_a_point_mass_that_cables_may_end_at(load):
    main = STAR.replace("lone: [9", "ball: [9").replace("string: [", "string: [[ball, q], ")
    main += "builders: {ball: {class: tgSphereInfo, parameters: {radius: 0.5, density: 3}}}\n"
    result = load(main)
    assert result.document["nodes"]["ball"]["mass"] == pytest.approx(4 / 3 * math.pi * 0.125 * 3)
    assert any("1 spheres are point masses" in note for note in result.notes)
    held = load(main.replace("density: 3", "density: 0")).document["nodes"]["ball"]
    assert held["anchored"] is True
    on_rod = load(main.replace("[ball, q], ", "").replace("ball: {class", "p: {class"))
    assert on_rod.document["nodes"]["p"]["mass"] == pytest.approx(4 / 3 * math.pi * 0.125 * 3)


def test_a_pretension_that_is_too_large_has_a_way_on(load):
    main = PAIR.replace("pretension: 10", "pretension: 60")
    with pytest.raises(InvalidValueError) as caught:
        load(main)
    factor = float(caught.value.hint.rpartition("=")[2].strip("`"))
    document = load(main, pretension_scale=factor).document
    structure, _ = assemble(parse_scene(document))
    assert structure.static_tension()[~structure.is_bar] == pytest.approx([60 * factor] * 4)
