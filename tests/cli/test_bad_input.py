"""Bad scenes through the command line: exit code 2, a message with file, key and value, nothing written."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import Ended, Run
from tests.cli.scenes import GOOD, HANGING, write

NODE_B = "b = { position = [0, 0, -1], mass = 1.0 }"
MEMBER = 's1 = { class = "string", nodes = ["a", "b"] }'
STIFFNESS = "spring_constant = 100.0"

# what is spoiled: (text, its replacement, error, words of the message)
SPOILED = {
    "unknown key": ("mass = 1.0", "mas = 1.0", "UnknownKeyError", ("nodes.b", "mas", "mass")),
    "unknown section": ("[nodes]", "[knots]", "UnknownKeyError", ("knots", "nodes")),
    "misspelt class": ('class = "string"', 'class = "strng"', "UnknownNameError", ("s1", "strng", "string")),
    "undefined node": ('["a", "b"]', '["a", "c"]', "UnknownNameError", ("s1", "'c'")),
    "member to itself": ('["a", "b"]', '["a", "a"]', "StructureError", ("s1", "'a'")),
    "one pair twice": (
        MEMBER,
        f'{MEMBER}\ns2 = {{ class = "string", nodes = ["b", "a"] }}',
        "DuplicateNameError",
        ("s1", "s2"),
    ),
    "one name twice": (NODE_B, f"{NODE_B}\n{NODE_B}", "DuplicateNameError", ("line 11", "b")),
    "negative stiffness": (STIFFNESS, "spring_constant = -1.0", "InvalidValueError", ("string", "-1.0")),
    "zero stiffness": (STIFFNESS, "spring_constant = 0.0", "InvalidValueError", ("string", "0.0")),
    "negative axial stiffness": (STIFFNESS, "axial_stiffness = -2.0", "InvalidValueError", ("-2.0",)),
    "negative rest length": ("rest_length = 0.9", "rest_length = -0.9", "InvalidValueError", ("-0.9",)),
    "zero rest length": ("rest_length = 0.9", "rest_length = 0", "InvalidValueError", ("rest_length",)),
    "negative mass": ("mass = 1.0", "mass = -1.0", "InvalidValueError", ("nodes.b.mass", "-1.0")),
    "zero mass": ("mass = 1.0", "mass = 0.0", "InvalidValueError", ("nodes.b.mass", "0.0")),
    "a mass that is text": ("mass = 1.0", 'mass = "1 kg"', "InvalidValueError", ("nodes.b.mass", "1 kg")),
    "NaN position": ("[0, 0, -1]", "[0, nan, -1]", "NonFiniteError", ("nodes.b.position", "nan")),
    "infinite mass": ("mass = 1.0", "mass = inf", "NonFiniteError", ("nodes.b.mass", "inf")),
    "NaN stiffness": (STIFFNESS, "spring_constant = nan", "NonFiniteError", ("spring_constant", "nan")),
    "infinite rest length": ("rest_length = 0.9", "rest_length = inf", "NonFiniteError", ("rest_length",)),
    "NaN gravity": ("[classes", "gravity = [0, 0, nan]\n[classes", "NonFiniteError", ("gravity",)),
    "coincident nodes of a bar": (
        NODE_B,
        NODE_B + NODE_B.replace("b =", "\nc =") + '\n[members.s2]\nkind = "bar"\nspring_constant = 100.0\n'
        'rest_length = 0.5\nnodes = ["b", "c"]\n',
        "StructureError",
        ("s2",),
    ),
    "no free node": ("mass = 1.0", "anchored = true", "StructureError", ("free",)),
    "unconnected node": (NODE_B, f"{NODE_B}\nc = {{ position = [1, 0, 0] }}", "StructureError", ("nodes.c",)),
    "two stiffnesses": (STIFFNESS, f"{STIFFNESS}\naxial_stiffness = 5.0", "InvalidValueError", ("string",)),
    "no stiffness in a cable": (STIFFNESS, "", "InvalidValueError", ("spring_constant",)),
    "unknown quantity": (
        "[classes",
        '[model]\nquantities = ["speed"]\n[classes',
        "UnknownNameError",
        ("speed", "model.quantities"),
    ),
    "unknown formulation": (
        "[classes",
        '[model]\nformulation = "node_positions"\n[classes',
        "",
        ("node_positions", "node_position"),
    ),
    "negative friction": (
        "[nodes]",
        "[ground]\noffset = -2\nstiffness = 1e4\nfriction = -0.5\n[nodes]",
        "InvalidValueError",
        ("ground.friction", "-0.5"),
    ),
    "anchors in the ground": (
        "[nodes]",
        "[ground]\noffset = 0.5\nstiffness = 1e4\n[nodes]",
        "StructureError",
        ("ground.offset", "a (0.5 m deep)"),
    ),
    "not TOML": ("[classes.string]", "[classes.string", "SceneSyntaxError", ("line 3",)),
}

NAMES = ('x"y', "../x", "x\ny")  # tests/scene/test_names.py has all kinds
PLACES: dict[str, Callable[[str], str]] = {
    "scene": lambda name: GOOD.replace('"small"', name),
    "node": lambda name: GOOD.replace("b = {", f"{name} = {{").replace('"b"]', f"{name}]"),
    "member": lambda name: GOOD.replace("s1 = {", f"{name} = {{"),
    "class": lambda name: GOOD.replace("[classes.string]", f"[classes.{name}]").replace('"string"', name),
    "group": lambda name: GOOD + f'\n[groups]\n{name} = ["s1"]\n',
    "input": lambda name: GOOD + f'\n[[inputs]]\nname = {name}\nkind = "rest_length"\nmembers = ["s1"]\n',
}


def assert_refused(ended: Ended, path: Path, error: str, words: tuple[str, ...]) -> None:
    assert ended.code == 2
    data = ended.data
    assert data["status"] == "error"
    assert not error or data["error"] == error
    message = " ".join(str(data[key]) for key in ("where", "problem", "given", "allowed", "hint"))
    assert data["where"].startswith(path.name)
    assert data["allowed"] or data["hint"]
    assert [word for word in words if word not in message] == []
    assert ended.err.startswith("error: ")
    assert "Traceback" not in ended.err


@pytest.mark.parametrize("case", SPOILED)
def test_a_spoiled_scene_is_refused_by_name_and_nothing_is_written(case: str, run: Run, folder: Path) -> None:
    old, new, error, words = SPOILED[case]
    assert GOOD.count(old) == 1
    path = write(folder / "small.toml", GOOD.replace(old, new))
    assert_refused(run("check", path.name, "--json"), path, error, words)
    assert_refused(run("build", path.name, "--out", "library", "--json"), path, error, words)
    assert_refused(run("simulate", path.name, "--t-end", 1, "--out", "a.npz", "--json"), path, error, words)
    assert [item.name for item in folder.iterdir()] == [path.name]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("place", PLACES)
def test_a_name_that_is_no_identifier_is_refused(place: str, name: str, run: Run, folder: Path) -> None:
    escaped = name.replace('"', '\\"').replace("\n", "\\n")
    path = write(folder / "small.toml", PLACES[place](f'"{escaped}"'))
    ended = run("build", path.name, "--out", "library", "--json")
    assert_refused(ended, path, "InvalidNameError", ())
    assert ended.data["where"].isprintable()
    assert list(folder.iterdir()) == [path]


def test_the_good_scene_is_good(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", GOOD)
    assert run("check", path.name, "--json").data["warnings"] == []


@pytest.mark.parametrize("text", ["", "\n\n# nothing here\n", 'name = "small"\n', "[nodes]\n[members]\n"])
def test_an_empty_scene_is_refused(text: str, run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", text)
    assert_refused(run("check", path.name, "--json"), path, "", ())


def test_ten_megabytes_of_rubbish_are_refused(run: Run, folder: Path) -> None:
    """Of one kind; tests/scene/test_read.py has the others."""
    path = folder / "small.toml"
    path.write_bytes(b"x=1\n" * 2_500_000)
    ended = run("check", path.name, "--json")
    assert_refused(ended, path, "", ())
    assert len(ended.out) < 2000


@pytest.mark.parametrize("text", [GOOD.replace("rest_length = 0.9", "rest_length = 0.5"), HANGING])
def test_units_that_look_wrong_are_a_warning(text: str, run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", text)
    ended = run.good("check", path.name, "--json")
    warned = any("s1" in text for text in ended.data["warnings"])
    assert warned == ("0.5" in text)
    assert ("warning: " in ended.err) == bool(ended.data["warnings"])


@pytest.mark.parametrize(
    "make",
    [
        lambda path: path.mkdir(),
        lambda path: None,
        lambda path: path.symlink_to("nowhere"),
        lambda path: path.symlink_to(path.name),
        lambda path: path.write_bytes(b"\xff\xfe\x00\x01"),
        lambda path: path.write_bytes(b'name = "\xe9"'),
    ],
    ids=["folder", "missing", "dangling link", "circular link", "binary", "Latin-1"],
)
def test_what_is_no_scene_file_is_refused(make: Callable[[Path], object], run: Run, folder: Path) -> None:
    path = folder / "small.toml"
    make(path)
    for verb in (["check"], ["build"], ["equilibrium"], ["linearize"], ["show", "-o", "a.png"]):
        assert_refused(run(verb[0], path.name, *verb[1:], "--json"), path, "", ())


def test_an_integrator_without_masses_names_the_node_first(run: Run, folder: Path) -> None:
    text = GOOD.replace(", mass = 1.0", "") + '[model]\nintegrators = ["rk54"]\n'
    ended = run.refused("check", write(folder / "small.toml", text), "--json")
    assert ended.data["where"].endswith("nodes.b.mass")
    assert "no mass at b" in str(ended.data["given"])
