"""Names that try to leave their place in C, comments, shells, make, CMake, XML, JSON, paths and Python."""

import json
import keyword

from hypothesis import strategies as st

# What each language would end, start or expand.
ENDS = (
    *("*/", "/*", "//", "??/", "??)", "\\\n", '"', "'", "`", "$(id)", "${HOME}", "$(shell id)", "%s%n", "%"),
    *("\x00",),
    *("\n#include </etc/passwd>", "#define int", "\r", "\t", ";", "&&id", "|id", ">id", "..", "../", "/"),
    *("\\", ":"),
    *("]]>", "<!--", "&amp;", "<x>", '"""', "\u2028", "\u202e", "\ufeff", "ä", "名", "\U0001f600"),
    *("\x1b[31m", "\x7f"),
    *("-rf", "--help", "~", "*", "?", "[a]", "{a}", "@", "=", "a b", " a", "a ", ""),
)
WORDS = (
    *("int", "while", "_Bool", "restrict", "class", "new", "and_eq", "typeof", "NULL", "errno", "main"),
    *("printf",),
    *("assert", "linux", "unix", "complex", "I", "stdin", "INFINITY", "double_t", "jac", "fwd", "group0"),
    *("a__b",),
    *("math", "stdio", "Errno", "con", "CON", "nul", "aux", "prn", "com1", "LPT9", "example", "Makefile"),
    *("makefile", "GNUmakefile"),
    *("None", "lambda", "import", "def", "self", "numpy", "json", "codegen", "__init__", "x_", "_x", "1a"),
    *("a1",),
    *("n" * 63, "n" * 64, "N" * 5000, "prism", "input", "coordinate", "gravity", "work", "state", "run"),
)
NAMES = st.one_of(
    st.sampled_from(WORDS),
    st.sampled_from(ENDS),
    st.sampled_from(keyword.kwlist),
    st.tuples(st.sampled_from(["", "a", "node"]), st.sampled_from(ENDS), st.sampled_from(["", "b", "1"])).map(
        "".join
    ),
    st.text(max_size=12),
    st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,62}", fullmatch=True),
)
# Where a scene has names; "file" is the name of nothing but the folder that is written.
PLACES = ("scene", "node", "member", "class", "group", "input", "actuator", "sensor")
SCENE = """\
name = {scene}
[model]
quantities = ["member_tension", "acceleration"]
integrators = ["rk4"]
[nodes]
root = {{ position = [0, 0, 0], anchored = true }}
{node} = {{ position = [1, 0, 0], mass = 1 }}
[classes.{class}]
kind = "cable"
spring_constant = 10
[members]
{member} = {{ class = {class}, nodes = ["root", {node}], rest_length = 0.9 }}
[groups]
{group} = [{member}]
[[inputs]]
name = {input}
kind = "rest_length"
members = [{group}]
[[actuators]]
name = {actuator}
members = {member}
[[sensors]]
name = {sensor}
kind = "member_tension"
members = [{group}]
"""
USUAL = {place: f"a_{place}" for place in PLACES}


def names() -> st.SearchStrategy[str]:
    """Return names, of which about half are refused."""
    return NAMES


def format_scene(place: str, name: str) -> str:
    """Return a scene that has the name in one place, quoted as TOML asks."""
    words = {key: _quote(value) for key, value in (USUAL | {place: name}).items()}
    return SCENE.format(**words)


def _quote(text: str) -> str:
    """Return a string of TOML; JSON's escapes are a part of its own, but for surrogates and DEL."""
    quoted = json.dumps(text, ensure_ascii=False)
    return "".join(f"\\u{ord(c):04x}" if ord(c) in (0x7F,) or 0x80 <= ord(c) <= 0x9F else c for c in quoted)
