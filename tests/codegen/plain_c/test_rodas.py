"""The Rosenbrock method in C: conditions of order of its coefficients as they stand in the file, and a step.

Conditions by Hairer and Wanner 1996, IV.7, table 7.1 and (7.11); coefficients of stages by the sums of
G. Steinebach, BIT Numerical Mathematics 63 (2023) 27. In the form of the file alpha = a Gamma, b = m Gamma,
Gamma^-1 = 1 / gamma - C.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.codegen.plain_c.alone import FOLDER, options_for, run_c

TEXT = (FOLDER / "rodas.h").read_text(encoding="utf-8")


def read(name: str) -> np.ndarray:
    found = re.search(rf"double rodas_{name}(?:\[\d\])* = ([^;]*);", TEXT)
    assert found is not None, name
    return np.array(eval(found[1].replace("{", "[").replace("}", "]")))


GAMMA = float(read("gamma"))
STATE = np.zeros((8, 8))
STATE[:6, :5] = read("state")
STATE[6:, :5] = STATE[5, :5]
STATE[6, 5] = STATE[7, 5] = STATE[7, 6] = 1.0
COUPLING = np.zeros((8, 8))
COUPLING[:, :7] = read("coupling")
WHOLE = np.linalg.inv(np.eye(8) / GAMMA - COUPLING)
ALPHA = STATE @ WHOLE
BETA = ALPHA + WHOLE
ENDS = np.append(STATE[7, :7], 1.0)
A, B, ONE = ALPHA.sum(axis=1), BETA.sum(axis=1), np.ones(8)
# Left-hand side and right-hand side of each condition, by its order.
CONDITIONS = {
    1: [(ONE, 1.0)],
    2: [(B, 1 / 2)],
    3: [(A**2, 1 / 3), (BETA @ B, 1 / 6)],
    4: [(A**3, 1 / 4), (A * (ALPHA @ B), 1 / 8), (BETA @ A**2, 1 / 12), (BETA @ BETA @ B, 1 / 24)],
    5: [
        (A**4, 1 / 5),
        (A**2 * (ALPHA @ B), 1 / 10),
        ((ALPHA @ B) ** 2, 1 / 20),
        (A * (ALPHA @ A**2), 1 / 15),
        (A * (ALPHA @ BETA @ B), 1 / 30),
        (BETA @ A**3, 1 / 20),
        (BETA @ (A * (ALPHA @ B)), 1 / 40),
        (BETA @ BETA @ A**2, 1 / 60),
        (BETA @ BETA @ BETA @ B, 1 / 120),
    ],
}


def residuals(weight: np.ndarray, order: int, s: float = 1.0) -> np.ndarray:
    """Residuals of the conditions of one order, for weights of the stages at fraction s of a step."""
    return np.array([weight @ WHOLE @ left - right * s**order for left, right in CONDITIONS[order]])


def test_the_step_has_order_five_and_its_error_estimate_four() -> None:
    for order in CONDITIONS:
        assert np.abs(residuals(ENDS, order)).max() < 2e-14
    embedded = ENDS - np.eye(8)[7]
    assert max(np.abs(residuals(embedded, order)).max() for order in (1, 2, 3, 4)) < 2e-14
    assert np.abs(residuals(embedded, 5)).max() > 1e-3


@pytest.mark.parametrize("s", [0.2, 0.5, 0.9])
def test_dense_output_has_order_four(s: float) -> None:
    first, second, third = read("dense")
    weight = s * ENDS + s * (1 - s) * (first + s * (second + s * third))
    assert max(np.abs(residuals(weight, order, s)).max() for order in (1, 2, 3, 4)) < 1e-9


def test_times_and_slopes_of_the_stages_are_the_sums_of_the_coefficients() -> None:
    np.testing.assert_allclose(read("node"), A, atol=1e-14)
    np.testing.assert_allclose(read("slope"), WHOLE.sum(axis=1), atol=1e-13)


def stability(z: complex) -> complex:
    return complex(1 + z * (ENDS @ WHOLE @ np.linalg.solve(np.eye(8) - z * BETA, ONE)))


def test_the_method_is_stable_on_the_left_and_damps_what_is_stiff() -> None:
    assert max(abs(stability(1j * w)) for w in np.linspace(0.01, 300.0, 3000)) <= 1.0 + 1e-12
    assert abs(stability(-1e6)) < 1e-4


def test_vibrations_lose_as_much_a_step_as_the_record_says() -> None:
    from tensegrity_codegen.tables.integrators import INTEGRATORS

    factor, power = INTEGRATORS["rodas"].vibration_loss
    for angle in np.linspace(1.0, 4.0, 13):
        changed = abs(stability(1j * angle) - np.exp(1j * angle))
        assert 1 / 3 < changed / (factor * angle**power) < 3


MAIN = r"""
#include <stdio.h>
#include <string.h>
#include "rodas.h"
const int scene_state_jacobian_row[2] = {1, 0}, scene_state_jacobian_column_start[3] = {0, 1, 2};
int main(void)
{
  static rodas_memory memory;
  static double rates[2 * RODAS_RATES], dense[2 * RODAS_DENSE];
  double change[2], trial[2], spare[2], error;
  const double stiffness = STIFFNESS, state[2] = {1.0, 0.0}, lost[2] = {0.0, 0.0};
  const motion_arguments with = {&stiffness, NULL};
  memset(&memory, 255, sizeof memory); /* NAN: nothing may be read before it is written */
  memset(rates, 255, sizeof rates);
  motion_rate(state, &with, rates);
  error = rodas_try(0.1, 1e-6, 1e-6, state, &with, lost, rates, change, trial, &memory);
  rodas_prepare(0.1, state, &with, trial, spare, rates, dense);
  printf("%.17g %.17g %.17g %.17g\n", trial[0], trial[1], error, dense[0]);
  return 0;
}
"""


@pytest.mark.parametrize("stiffness", [4.0, 1e12])
def test_a_step_multiplies_a_linear_motion_by_the_stability_function(
    stiffness: float, tmp_path: Path
) -> None:
    said = run_c(MAIN, tmp_path, f"-DSTIFFNESS={stiffness}", *options_for(1, False))
    place, speed, error, rise = map(float, said.split())
    w = np.sqrt(stiffness)
    expected = stability(0.1j * w)
    assert place == pytest.approx(expected.real, abs=1e-12)
    assert speed == pytest.approx(-w * expected.imag, abs=1e-12 * w)
    assert rise == pytest.approx(place - 1.0, abs=1e-15)
    assert error > 0.0


def test_a_step_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    said = run_c(MAIN, tmp_path, "-DSTIFFNESS=(double)NAN", *options_for(1, False))
    assert float(said.split()[2]) == np.inf
