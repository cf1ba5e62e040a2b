"""Results by name: numbers, members, reductions, and what is refused."""

import numpy as np
import pytest

from tensegrity_codegen.sweeps.summary.summary import choose_results
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.sweeps.summary.sweeps import keep, make_sweep

RNG = np.random.default_rng(1)
TENSION = RNG.normal(size=(7, 3))
POSITION = RNG.normal(size=(7, 2, 3))
STATUS = [1, 1, 2, 1, 1, 0, 1]
SWEEP = make_sweep(
    RNG.normal(size=(7, 1)),
    ["a"],
    [
        keep("node_position", POSITION, "m", ["node", "axis"], [("n1", "n2"), ("x", "y", "z")]),
        keep("member_tension", TENSION, "N", ["member"], [("s1", "s2", "bar1")]),
        keep("energy", TENSION[:, 0] ** 2, "J"),
    ],
    status=STATUS,
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("energy", TENSION[:, 0] ** 2),
        ("member_tension[bar1]", TENSION[:, 2]),
        ("member_tension[1]", TENSION[:, 1]),
        ("member_tension[-1]", TENSION[:, 2]),
        ("member_tension[max]", TENSION.max(axis=1)),
        ("node_position[n2,z]", POSITION[:, 1, 2]),
        ("node_position[ n2 , min ]", POSITION[:, 1].min(axis=1)),
        ("node_position[mean,z]", POSITION[:, :, 2].mean(axis=1)),
        ("node_position[max]", POSITION.max(axis=(1, 2))),
    ],
)
def test_a_result_is_one_number_a_case(text: str, expected: np.ndarray) -> None:
    (result,) = choose_results(SWEEP, [text])
    good = np.array(STATUS) != 2
    np.testing.assert_array_equal(result.values[good], expected[good])
    assert np.isnan(result.values[~good]).all()


def test_a_quantity_without_parts_is_its_extremes() -> None:
    assert [item.name for item in choose_results(SWEEP, ["member_tension"])] == [
        "member_tension[max]",
        "member_tension[min]",
    ]


def test_by_default_tensions_come_first_and_then_numbers() -> None:
    names = [item.name for item in choose_results(SWEEP)]
    assert names == ["member_tension[max]", "member_tension[min]", "energy"]


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("member_tensoin", UnknownNameError, "'member_tension'"),
        ("member_tension[bar2]", UnknownNameError, "'bar1'"),
        ("member_tension[3]", UnknownNameError, "0 to 2"),
        ("member_tension[s1,x]", InvalidValueError, "member_tension[MEMBER]"),
        ("node_position[n1]", InvalidValueError, "node_position[NODE,AXIS]"),
        ("energy[0]", InvalidValueError, "energy alone"),
        ("energy[", InvalidValueError, "NAME or NAME[PART,...]"),
        ("", InvalidValueError, "NAME"),
    ],
)
def test_what_no_result_is(text: str, error: type[Exception], words: str) -> None:
    with pytest.raises(error) as caught:
        choose_results(SWEEP, [text])
    assert words in str(caught.value)


def test_diagnostics_come_last_and_nothing_is_described_twice() -> None:
    values = np.arange(6.0)
    kept = [keep(name, values, "m") for name in ("change", "displacement", "residual", "smallest_eigenvalue")]
    kept.append(keep("member_tension_max", np.ones((6, 3)), "N", ["member"], [("a", "b", "c")]))
    kept.append(keep("member_tension_min", np.ones((6, 1)), "N", ["member"], [("a",)]))
    sweep = make_sweep(values[:, None], ["k"], kept)
    assert [item.name for item in choose_results(sweep)] == [
        *("member_tension_max[max]", "member_tension_min[a]", "change", "smallest_eigenvalue"),
    ]
    alone = make_sweep(values[:, None], ["k"], [keep("residual", values)])
    assert [item.name for item in choose_results(alone)] == ["residual"]


def test_what_the_user_kept_comes_first_in_this_order() -> None:
    values = np.arange(6.0)
    kept = [keep(name, values) for name in ("a", "member_tension", "z")]
    sweep = make_sweep(values[:, None], ["k"], kept, kept_names=["z = max(b)", "a"])
    assert [item.name for item in choose_results(sweep)] == ["z", "a", "member_tension"]


def test_entries_that_are_filled_up_are_not_counted() -> None:
    table = np.array([[1.0, 3.0, np.nan], [np.nan, np.nan, np.nan]])
    kept = [keep("natural_frequency", table, "Hz", ["mode"], [("1", "2", "3")])]
    sweep = make_sweep(np.arange(2.0)[:, None], ["k"], kept)
    names = [f"natural_frequency[{word}]" for word in ("max", "min", "mean")]
    values = [item.values.tolist() for item in choose_results(sweep, names)]
    np.testing.assert_array_equal(values, [[3.0, np.nan], [1.0, np.nan], [2.0, np.nan]])
