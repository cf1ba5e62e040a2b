"""What can be asked for, and what is refused."""

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.keep_text import parse_kept
from tensegrity_codegen.analyses.motions.case_motions import find_first_time, reduce_values
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, TensegrityError

TIME = np.array([0.0, 1.0, 3.0])
VALUES = np.array([[-1.0, 1.0, 3.0], [1.0, -1.0, 0.0], [-1.0, -2.0, -3.0]])


@pytest.mark.parametrize(
    ("text", "name", "expression", "reduction", "step"),
    [
        ("member_tension", "member_tension", "member_tension", "", 1),
        ("member_tension.max", "member_tension_max", "member_tension", "max", 1),
        ("node_position[t1].final", "node_position_t1_final", "node_position[t1]", "final", 1),
        ('node_position["t1", "z"].rms', "node_position_t1_z_rms", 'node_position["t1", "z"]', "rms", 1),
        ("t1.z.mean", "t1_z_mean", "t1.z", "mean", 1),
        ("max(member_tension).every(10)", "max_member_tension_every_10", "max(member_tension)", "every", 10),
        ("first(t1.z < 0.1)", "first_t1_z_0_1", "t1.z < 0.1", "first", 1),
        (" top = (t1.z - b1.z).min ", "top", "t1.z - b1.z", "min", 1),
        ("energy_drift", "energy_drift", "energy_drift", "", 1),
    ],
)
def test_texts_are_split_into_expression_and_reduction(
    text: str, name: str, expression: str, reduction: str, step: int
) -> None:
    (kept,) = parse_kept([text], ["energy_drift"], over_time=True)
    assert (kept.name, kept.reduction, kept.step) == (name, reduction, step)
    assert kept.expression.strip("()") == expression.strip("()")


def test_each_has_a_name_of_its_own() -> None:
    kept = parse_kept(["t1.z < 0 * 1".replace("<", "-"), "t1.z + 0 * 1"])
    assert [item.name for item in kept] == ["t1_z_0_1", "t1_z_0_1_2"]


@pytest.mark.parametrize(
    "texts",
    [
        *(["member_tensio"], ["member_tension["], ["member_tension < 3"], ["first(member_tension)"]),
        *(["member_tension.every(0)"], ["member_tension.every(1.5)"], ["member_tension.max(3)"]),
        *(
            ["status = t1.z"],
            ["t1.z.last"],
            ["import os"],
            ["first()"],
            [""],
            ["1/0"],
            ["first(t1.z > 0).max"],
        ),
    ],
)
def test_what_cannot_be_kept_is_refused_by_its_text(texts: list[str]) -> None:
    with pytest.raises(TensegrityError) as caught:
        parse_kept(texts, over_time=True)
    assert caught.value.where == f"keep {texts[0]!r}"


@pytest.mark.parametrize("texts", [["t1.z", "t1.z"], ["a = t1.z", "a = t1.x"]])
def test_nothing_is_kept_twice(texts: list[str]) -> None:
    with pytest.raises(DuplicateNameError):
        parse_kept(texts)


@pytest.mark.parametrize("text", ["t1.z.max", "first(t1.z > 0)", "t1.z.every(2)", "2 * time"])
def test_without_time_nothing_is_reduced_over_it(text: str) -> None:
    with pytest.raises(TensegrityError, match="there is no time"):
        parse_kept([text])


@pytest.mark.parametrize(
    ("reduction", "wanted"),
    [
        ("final", [3.0, 0.0, -3.0]),
        ("max", [3.0, 1.0, -1.0]),
        ("min", [-1.0, -1.0, -3.0]),
        ("mean", [(0 + 2 * 2) / 3, (0 - 0.5 * 2) / 3, (-1.5 - 2.5 * 2) / 3]),
        ("rms", np.sqrt([(1 + 5 * 2) / 3, (1 + 0.5 * 2) / 3, (2.5 + 6.5 * 2) / 3])),
        ("every(2)", [[-1.0, 3.0], [1.0, 0.0], [-1.0, -3.0]]),
    ],
)
def test_reductions_over_time(reduction: str, wanted: list[float]) -> None:
    (kept,) = parse_kept([f"total_energy.{reduction}"], over_time=True)
    np.testing.assert_allclose(reduce_values(kept, VALUES, TIME), wanted, rtol=1e-14)


def test_the_first_time_lies_between_samples() -> None:
    np.testing.assert_allclose(find_first_time(VALUES, TIME), [0.5, 0.0, np.nan])
    np.testing.assert_allclose(find_first_time(-VALUES, TIME), [0.0, 0.5, 0.0])


@pytest.mark.parametrize("name", ["member", "node", "axis", "plane_axis", "state_column", "mode", "time"])
def test_names_of_axes_are_refused_and_never_made(name: str) -> None:
    """Zarr keeps the labels of an axis in an array of its name."""
    with pytest.raises(InvalidValueError, match="another name"):
        parse_kept([f"{name} = max(member_tension)"], over_time=True)
    (kept,) = parse_kept([name], [name], over_time=True)
    assert kept.name == f"{name}_value"
    with pytest.raises(InvalidValueError, match="another name"):
        parse_kept([f"time_every_3 = {name} + 1"], over_time=True)


def test_each_member_has_a_first_time_of_its_own() -> None:
    values = np.stack([VALUES, -VALUES], axis=-1)
    found = find_first_time(values, TIME)
    np.testing.assert_allclose(found, [[0.5, 0.0], [0.0, 0.5], [np.nan, 0.0]])
