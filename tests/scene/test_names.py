import re

import pytest

from tensegrity_codegen.scene.names import (
    KEYWORDS,
    NAME_PATTERN,
    check_name,
    check_names,
    is_name,
    key_path,
    unknown_key,
)
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidNameError


@pytest.mark.parametrize("name", ["a", "A1", "left_strut", "x" * 63, "main", "i"])
def test_good_names(name):
    assert is_name(name)
    check_name(name)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "1a",
        "_a",
        "a-b",
        "a b",
        "a;b",
        "../a",
        "a\n",
        'a"',
        "a'",
        "x" * 64,
        "é",
        "int",
        "class",
        "a.b",
        "a\0",
    ],
)
def test_names_that_are_refused(name):
    assert not is_name(name)
    with pytest.raises(InvalidNameError) as caught:
        check_name(name, "a.toml: nodes")
    assert caught.value.given == name
    assert caught.value.where == "a.toml: nodes"
    assert "letter" in caught.value.allowed


def test_a_name_that_is_no_text_is_refused():
    with pytest.raises(InvalidNameError):
        check_name(3)  # type: ignore[arg-type]


def test_keywords_match_the_pattern_so_that_only_the_list_refuses_them():
    assert all(re.search(NAME_PATTERN, word) for word in KEYWORDS)


def test_check_names_finds_the_double():
    check_names(["a", "b"], "nodes")
    with pytest.raises(DuplicateNameError) as caught:
        check_names(["a", "b", "a"], "nodes", "f")
    assert caught.value.given == "a"
    assert caught.value.where == "f: nodes"


def test_key_path_writes_places_as_toml_does():
    assert key_path("f.toml", "nodes", "a1", "mass") == "f.toml: nodes.a1.mass"
    assert key_path("f.toml", "loads", 0, "force", 2) == "f.toml: loads[0].force[2]"
    assert key_path("", "nodes") == "nodes"
    assert key_path("f.toml") == "f.toml"
    assert key_path("f", "nodes", "a\n;") == 'f: nodes."a\\n;"'
    assert len(key_path("f", "x" * 10_000)) < 100


def test_long_lists_of_known_keys_are_cut_and_the_nearest_is_named():
    error = unknown_key("n7.z", [f"t{i}.x" for i in range(300)] + ["n5.z"], "m.csv: line 1", "unknown column")
    assert error.allowed.endswith("t38.x, t39.x and 261 more")
    assert "'n5.z'" in error.hint
    assert unknown_key("b", ["a", "c"], "").allowed == "a, c"
