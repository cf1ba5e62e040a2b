# ruff: noqa: E501
"""Texts made to break readers: scenes, tables, structure files and conditions, drawn by Hypothesis.

Each case is a list of (file name, bytes) and the words of the command line, or the text of a condition.
"""

import json
from typing import Any

from hypothesis import strategies as st

Case = tuple[list[tuple[str, bytes]], list[str]]

WORDS = st.sampled_from(
    [
        *("a", "b", "a__b", "x_", "example", "Makefile", "int", "jac", "NULL", "__", "a b", "ä", "\u202e"),
        *("", "n" * 64, "\x00", "\ud7ff", "=", "]", "'", '"', "nan", "all", "N" * 5000, "group0", "motion"),
        *("-", "1e400"),
    ]
)
NUMBERS = st.one_of(
    st.sampled_from([0, -0.0, 1, -1, 1e308, -1e308, 5e-324, 10**20, 10**300, 1e-200, 3, 2**63]),
    st.floats(allow_nan=False, allow_infinity=False),
)
RAW = st.sampled_from(
    [
        "nan",
        "inf",
        "-inf",
        "9" * 490,
        "1e999",
        "true",
        "1979-05-27",
        "[]",
        "{}",
        '""',
        "[1,2]",
        "[[1,0,0]]",
        "[" * 3000 + "]" * 3000,
        "{a=" * 300 + "1" + "}" * 300,
        "[0,0,0,0]",
        '["a","b"]',
        "'''x",
        "0x10",
        "1_0",
        "[" + "{}," * 200001 + "]",
        "[" + '"m!",' * 100000 + "]",
        "a.b",
        '"\\ud800"',
        "[nan,0,0]",
        '"' + "x" * 100000 + '"',
    ]
)
KEYS = (
    *("name", "axes", "gravity", "nodes", "members", "classes", "shape", "groups", "loads", "inputs"),
    *("parameters", "bodies", "tendons", "joint_friction", "interference", "position", "mass", "kind"),
    *(
        "model",
        "stages",
        "anchored",
        "velocity",
        "spring_constant",
        "rest_length",
        "prestress",
        "bars",
        "height",
        "quantities",
    ),
)
GOOD = (
    'name = "s"\n[nodes]\na = { position = [0, 0, 0], anchored = true }\nb = { position = [1, 0, 0], mass = 1 }\n'
    '[members]\nc = { kind = "cable", nodes = ["a", "b"], spring_constant = 10 }\n'
)


def _value(value: Any) -> str:
    return json.dumps(value)


VALUES = st.one_of(RAW, NUMBERS.map(_value), WORDS.map(_value), st.lists(NUMBERS, max_size=5).map(_value))


@st.composite
def _edited(draw: st.DrawFn) -> str:
    """A good scene with values, names and lines replaced."""
    text = GOOD
    for _ in range(draw(st.integers(1, 4))):
        old = draw(
            st.sampled_from(['"s"', "[0, 0, 0]", "true", "[1, 0, 0]", "1 }", '"cable"', '["a", "b"]', "10"])
        )
        text = text.replace(old, draw(VALUES), 1)
    extra = draw(st.lists(st.tuples(st.sampled_from(KEYS), VALUES), max_size=3))
    head = "".join(f"{key} = {value}\n" for key, value in extra)
    name = draw(st.one_of(st.just(""), WORDS))
    tail = f"[nodes.{json.dumps(name)}]\nposition = {draw(VALUES)}\n" if name else ""
    return head + text + tail


@st.composite
def _repeated(draw: st.DrawFn) -> str:
    """Millions of tiny things, or thousands of things of one stem."""
    line, most = draw(
        st.sampled_from(
            [
                ("[[loads]]\n", 700000),
                ("[nodes.n@]\n", 300000),
                ("n@ = {}\n", 500000),
                ('"n@!" = 1\n', 300000),
                ("loads = [" + "{}," * 1000000 + "]\n", 1),
                ("a." * 40 + "b = 1\n", 1),
                ("# {}\n", 1000000),
                ("n@ = { position = [0, 0, @] }\n", 250000),
                ("[shape]\nkind = 'tower'\nstages = 1@\n", 1),
            ]
        )
    )
    count = draw(st.integers(1, most))
    section = draw(st.sampled_from(["", "[nodes]\n", "[members]\n", "[groups]\n", "[classes.a]\n"]))
    return 'name = "s"\n' + section + "".join(line.replace("@", str(i)) for i in range(count))


@st.composite
def _encoded(draw: st.DrawFn, texts: st.SearchStrategy[str]) -> bytes:
    text = draw(texts)
    how = draw(st.sampled_from(["utf-8"] * 6 + ["utf-8-sig", "utf-16", "latin-1", "cut", "noise"]))
    if how == "cut":
        return text.encode()[: draw(st.integers(0, 400))]
    if how == "noise":
        return draw(st.binary(max_size=300)) + text.encode()[:300]
    return text.encode(how, errors="replace")


@st.composite
def scenes(draw: st.DrawFn) -> Case:
    """A scene file for the verb check."""
    texts = draw(st.sampled_from([_edited(), _edited(), _edited(), _repeated(), st.text(max_size=300)]))
    return [("s.toml", draw(_encoded(texts)))], ["check", "s.toml"]


CELLS = st.one_of(
    WORDS, NUMBERS.map(str), st.sampled_from(["9" * 490, "nan", "1,5", "cable", "bar", "n1", "a", "xz"])
)


@st.composite
def _table(draw: st.DrawFn, header: str, good: str) -> str:
    rows = draw(st.lists(st.lists(CELLS, min_size=4, max_size=9), max_size=5))
    text = header + good * draw(st.integers(0, 2)) + "".join(",".join(row) + "\n" for row in rows)
    if draw(st.integers(0, 5)) == 0:
        count = draw(st.sampled_from([20_000, 150_000, 1_000_000]))
        text += "".join(
            good.replace("@", str(i)).replace("n1", f"n {'-' * (i % 30)}{i}") for i in range(count)
        )
    return text


@st.composite
def tables(draw: st.DrawFn) -> Case:
    """Two tables for the verb import."""
    nodes = draw(_encoded(_table("node,x,y,z,mass\n", "n1,0,0,1,1\n")))
    members = draw(_encoded(_table("kind,node_i,node_j,spring_constant\n", "cable,n1,a,10\n")))
    name = draw(st.sampled_from(["n.csv", "tower - final (2).csv", "example.csv", "int.csv"]))
    return [(name, nodes), ("m.csv", members)], ["import", name, "m.csv", "-o", "out.toml", "--overwrite"]


@st.composite
def _yaml(draw: st.DrawFn) -> str:
    n = draw(st.sampled_from([1, 10, 1000, 20_000]))
    scalar = st.one_of(
        WORDS.map(_value), NUMBERS.map(str), st.sampled_from([".nan", "1e60", "*a", "&b [*b]", "~"])
    )
    x = draw(scalar)
    parts = [
        "nodes:\n  a: [0, 0, 0]\n  b: [1, 0, 0]\n  c: [0, 1, 0]\n",
        f"nodes:\n  a: [0, 0, {x}]\n  {x}: [1, 0, 0]\n",
        "builders:\n  rod: {class: tgRodInfo, parameters: {radius: 1e40, density: " + x + "}}\n",
        "builders:\n" + "".join(f"  b{i}: {{class: tgRodInfo}}\n" for i in range(min(n, 3000))),
        "pair_groups:\n  rod: &p ["
        + "[a, b], " * n
        + "]\n"
        + "".join(f"  r{i}: *p\n" for i in range(n % 999)),
        "pair_groups:\n  k0: &k0 [a]\n"
        + "".join(f"  k{i}: &k{i} [*k{i - 1}, *k{i - 1}]\n" for i in range(1, 40)),
        "substructures:\n  " + "/".join(f"c{i}" for i in range(min(n, 150))) + ": {path: s.yaml}\n",
        "substructures:\n  "
        + "/".join(f"c{i}" for i in range(min(n, 150)))
        + ": {path: part.yaml, scale: "
        + x
        + "}\n",
        "bond_groups:\n  " + x + ":\n    a/b/node_edge: [[a, b/c]]\n",
        "nodes: " + "[" * n + "]" * n + "\n",
    ]
    return "".join(draw(st.lists(st.sampled_from(parts), min_size=1, max_size=4, unique=True)))


@st.composite
def structures(draw: st.DrawFn) -> Case:
    """An NTRT structure file, with one that it may refer to, for the verb import."""
    files = [("s.yaml", draw(_encoded(_yaml()))), ("part.yaml", draw(_encoded(_yaml())))]
    return files, ["import", "s.yaml", "-o", "out.toml", "--overwrite"]


def conditions() -> st.SearchStrategy[str]:
    """Texts of conditions: grammar with wrong kinds, and plain noise."""
    names = [
        *("abs", "min", "max", "sum", "sqrt", "time", "member_length", "node_position", "n1.x", "n1.w"),
        *("total_energy",),
    ]
    numbers = ["0", "1", "-1", "1e308", "1e999", "9" * 490, "0.5", "True", "1j", "'a'", "...", "x"]
    leaf = st.sampled_from(
        [*names, *numbers, 'member_length["e0"]', "member_length[7]", "node_position[0, 'x']", "min[0]"]
    )

    def grow(part: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        return st.one_of(
            st.tuples(
                part, st.sampled_from(["+", "-", "*", "/", "**", "<", ">=", "==", "%", "@", " if "]), part
            ).map(" ".join),
            st.tuples(
                st.sampled_from(["abs", "min", "max", "sum", "sqrt", "exp"]), st.lists(part, max_size=3)
            ).map(lambda pair: f"{pair[0]}({', '.join(pair[1])})"),
            part.map(lambda text: f"({text})"),
            part.map(lambda text: f"-{text}"),
            st.tuples(part, part).map(lambda pair: f"{pair[0]}[{pair[1]}]"),
        )

    return st.one_of(st.recursive(leaf, grow, max_leaves=8), st.text(max_size=60), st.just("-" * 499 + "1"))
