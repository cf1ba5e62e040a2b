"""Profiles in CSV files: as people write them, and spoiled."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen import Profile, read_profile
from tensegrity_codegen.system.errors import SceneError
from tests.cases import draws

INPUTS = ("motor", "push")


@pytest.mark.parametrize(
    "text",
    [
        "time,motor\n0,0\n0.5,0.01\n1,0.02\n",
        "\ufefftime; motor\r\n0; 0\r\n\r\n0.5; 1e-2\r\n1; .02\r\n",
        "motor\ttime\n0\t0\n0.01\t0.5\n0.02\t1\n",
    ],
)
def test_a_table_as_spreadsheets_write_it(tmp_path: Path, text: str) -> None:
    file = tmp_path / "pull.csv"
    file.write_text(text, encoding="utf-8", newline="")
    profile = read_profile(file, INPUTS, "cubic")
    assert profile.kind == "cubic"
    assert profile.time.tolist() == [0.0, 0.5, 1.0]
    assert {name: array.tolist() for name, array in profile.values.items()} == {"motor": [0.0, 0.01, 0.02]}


@pytest.mark.parametrize(
    ("text", "name", "parts"),
    [
        ("", "SceneError", ["empty"]),
        ("\n \n", "SceneError", ["empty"]),
        ("time,motor\n", "InvalidValueError", ["no rows"]),
        ("time\n0\n1\n", "InvalidValueError", ["no column of an input", "motor or push"]),
        ("motor\n0\n1\n", "InvalidValueError", ["lacks the column time"]),
        ("time,moter\n0,0\n1,0\n", "UnknownKeyError", ["unknown column", "'moter'", "did you mean 'motor'?"]),
        ("time,motor,motor\n0,0,0\n1,0,0\n", "DuplicateNameError", ["a column appears twice", "motor"]),
        ("time,motor\n0,0\n1,abc\n", "InvalidValueError", ["not a number", "line 3, column motor", "'abc'"]),
        ("time,motor\n0,0\n1,\n", "InvalidValueError", ["the cell is empty", "line 3, column motor"]),
        ("time,motor\n0,0\n1,nan\n", "NonFiniteError", ["not a finite number", "line 3, column motor"]),
        ("time,motor\n0,0\n1,1e999\n", "NonFiniteError", ["too large", "line 3"]),
        ("time,motor\n0,0\n1\n", "SceneSyntaxError", ["too few cells", "line 3"]),
        ("time,motor\n0,0\n2,0\n1,0\n", "InvalidValueError", ["the time goes back", "1.0 at knot 2"]),
        ("time,motor\n0.1,0\n2,0\n", "InvalidValueError", ["does not start at 0", "0.1"]),
        ("time,motor\n0,0\n", "InvalidValueError", ["too few knots"]),
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path: Path, text: str, name: str, parts: list[str]) -> None:
    file = tmp_path / "pull.csv"
    file.write_text(text)
    with pytest.raises(SceneError) as caught:
        read_profile(file, INPUTS)
    for part in (str(file), *parts):
        assert part in str(caught.value)
    assert type(caught.value).__name__ == name or name == "SceneError"


def test_no_file_and_no_inputs(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"none\.csv"):
        read_profile(tmp_path / "none.csv", INPUTS)
    with pytest.raises(SceneError, match="no inputs"):
        read_profile(tmp_path / "none.csv", ())
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01time")
    with pytest.raises(SceneError, match=r"binary\.csv"):
        read_profile(tmp_path / "binary.csv", INPUTS)


CELLS = st.one_of(
    st.sampled_from(
        ["", "time", "motor", "push", "nan", "-inf", "1e999", "1e308", "-1e308", "5e-324", "0", "1"]
    ),
    st.sampled_from(["1,5", '"', "'", "\x00", "ä", "=1+1", "9" * 400, "0x10", "1_0", "+.5", " 2 "]),
    st.floats(0.0, 3.0).map(repr),
)
LINES = st.lists(CELLS, max_size=4).map(",".join)
SORTED = st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(-1e3, 1e3)), max_size=6).map(
    lambda rows: ["0,0", *(f"{time!r},{value!r}" for time, value in sorted(rows))]
)


def try_to_read(file: Path, kind: str) -> Profile | str:
    """Return the profile of a file, or the words of the error that refuses it."""
    try:
        return read_profile(file, INPUTS, kind)
    except SceneError as error:
        return str(error)


@draws(25)
@given(st.one_of(st.just("time,motor"), LINES), st.one_of(SORTED, st.lists(LINES, max_size=6)))
def test_hostile_tables_are_profiles_or_named_errors(tmp_path: Path, head: str, lines: list[str]) -> None:
    file = tmp_path / "pull.csv"
    file.write_bytes("\n".join([head, *lines]).encode())
    for kind in ("linear", "cubic"):
        profile = try_to_read(file, kind)
        if isinstance(profile, str):
            assert str(file) in profile
            continue
        assert profile.time[0] == 0.0
        assert (np.diff(profile.pieces.time) > 0.0).all()
        assert np.isfinite(profile.pieces.coefficient).all()
        assert len(profile.pieces.is_kink) == len(profile.pieces.time) == len(profile.pieces.coefficient) + 1
