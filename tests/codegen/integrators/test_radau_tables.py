"""The numbers of Radau IIA with three stages, by what they must do."""

import re

import numpy as np
import pytest

from tests.codegen.integrators.radau_coefficients import radau_coefficients
from tests.codegen.plain_c.alone import FOLDER

TABLE = {name: np.array(value, dtype=float) for name, value in radau_coefficients().items()}
NODE, D = TABLE["node"], TABLE["derivative"]


@pytest.mark.parametrize("power", [1, 2, 3])
def test_d_differentiates_polynomials_that_vanish_at_zero(power: int) -> None:
    np.testing.assert_allclose(D @ NODE**power, power * NODE ** (power - 1), rtol=1e-14)


@pytest.mark.parametrize("degree", range(5))
def test_the_method_has_order_five(degree: int) -> None:
    """Stage 3 of the inverse of D integrates polynomials of degree 4 exactly."""
    weights = np.linalg.inv(D)[2]
    assert weights @ NODE**degree == pytest.approx(1 / (degree + 1), rel=1e-13)


def test_the_transform_splits_d_into_a_real_number_and_a_pair() -> None:
    re, im = float(TABLE["re"]), float(TABLE["im"])
    split = np.array([[float(TABLE["real"]), 0, 0], [0, re, im], [0, -im, re]])
    np.testing.assert_allclose(TABLE["inverse_transform"] @ D @ TABLE["transform"], split, atol=1e-13)
    np.testing.assert_allclose(TABLE["inverse_transform"] @ TABLE["transform"], np.eye(3), atol=1e-14)


def test_powers_and_sums_of_d() -> None:
    np.testing.assert_allclose(TABLE["second_derivative"], D @ D, rtol=1e-12)
    np.testing.assert_allclose(TABLE["derivative_sum"], D.sum(axis=1), rtol=1e-13)


@pytest.mark.parametrize("power", [0, 1, 2])
def test_parabolas_through_the_stages_are_carried_to_both_ends(power: int) -> None:
    value = NODE**power
    assert TABLE["to_start"] @ value == pytest.approx(0.0**power, abs=1e-14)
    assert TABLE["slope"] @ value == pytest.approx(power, abs=1e-13)
    assert TABLE["curvature"] @ value == pytest.approx(power * (power - 1), abs=1e-13)


def test_the_c_file_has_these_numbers() -> None:
    text = (FOLDER / "radau_constants.h").read_text(encoding="utf-8")
    names = {"node": "node", "d": "derivative", "d2": "second_derivative", "d1": "derivative_sum"}
    names |= {"t": "transform", "ti": "inverse_transform", "to_start": "to_start"}
    names |= {"slope": "slope", "curvature": "curvature"}
    for name, key in names.items():
        found = re.search(rf"radau_{name}(?:\[3\])+ = (.*?);", text, re.DOTALL)
        assert found is not None, name
        numbers = [float(word) for word in re.findall(r"[-+\d.e]+", found[1])]
        np.testing.assert_array_equal(numbers, TABLE[key].ravel(), err_msg=name)
    for name in ("real", "re", "im"):
        assert f"radau_{name} = {float(TABLE[name])!r}" in text
