"""What an example printed is compared line by line: nothing may be missing, renamed or different."""

import pytest
from trial.rows import Row, compare_rows, parse_rows

TEXT = "tension_moved bar1 -13.5 N\ntension_moved top1 5 N\nmotion_0.05s t1_x 0.25 m\nslack top1 0.012 s\n"
EXPECTED = parse_rows(TEXT)


def test_lines_become_rows() -> None:
    assert EXPECTED[0] == Row("tension_moved", "bar1", -13.5, "N")
    assert len(EXPECTED) == 4


@pytest.mark.parametrize("line", ["tension bar1 5", "tension bar1 5 N more", "tension bar1 five N", "hello"])
def test_a_line_that_is_no_row_is_an_error(line: str) -> None:
    with pytest.raises(ValueError):
        parse_rows(TEXT + line)


def test_equal_numbers_have_no_problems() -> None:
    compared = compare_rows(EXPECTED, EXPECTED)
    assert compared.problems == ()
    assert set(compared.largest.values()) == {0.0}


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("-13.5", "-13.4999"),
        ("-13.5", "nan"),
        ("0.25", "0.250001"),
        ("0.012", "0.0120001"),
        ("0.012 s", "0.012 ms"),
        ("bar1", "bar2"),
        ("slack", "taut"),
        ("tension_moved top1 5 N\n", ""),
        ("slack top1 0.012 s\n", "slack top1 0.012 s\nslack top2 0.013 s\n"),
        ("tension_moved bar1 -13.5 N\ntension_moved top1 5 N\n", "tension_moved top1 5 N\n" * 2),
    ],
)
def test_every_difference_is_found(old: str, new: str) -> None:
    assert old in TEXT
    assert compare_rows(parse_rows(TEXT.replace(old, new, 1)), EXPECTED).problems != ()


def test_differences_within_rounding_are_none() -> None:
    near = parse_rows(TEXT.replace("-13.5", "-13.50000000001"))
    compared = compare_rows(near, EXPECTED)
    assert compared.problems == ()
    assert 0 < compared.largest["tension_moved"] < 1e-11
