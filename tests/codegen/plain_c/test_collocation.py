"""Radau IIA in C, with the Jacobian of the state: a step against its stability function, and its refusals.

Hairer and Wanner 1996, IV.5: R(z) = (1 + 2 z / 5 + z^2 / 20) / (1 - 3 z / 5 + 3 z^2 / 20 - z^3 / 60).
"""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.tables.integrators import find_row
from tests.codegen.plain_c.alone import options_for, run_c

MAIN = r"""
#include <stdio.h>
#include <string.h>
#include "collocation.h"
const int scene_state_jacobian_row[2] = {1, 0}, scene_state_jacobian_column_start[3] = {0, 1, 2};
int main(void)
{
  static collocation_memory memory;
  static double rates[2 * COLLOCATION_RATES];
  double change[2], trial[2], error;
  const double stiffness = STIFFNESS, state[2] = {1.0, 0.0}, lost[2] = {0.0, 0.0};
  const motion_arguments with = {&stiffness, NULL};
  memset(&memory, 255, sizeof memory); /* NAN: nothing may be read before it is written */
  memset(rates, 255, sizeof rates);
  motion_rate(state, &with, rates);
  error = collocation_try(0.1, 1e-9, 1e-9, state, &with, lost, rates, change, trial, &memory);
  printf("%.17g %.17g %.17g %lld ", trial[0], trial[1], error, memory.n_evaluations);
  printf("%.17g %.17g\n", rates[2 * COLLOCATION_STAGES], rates[2 * COLLOCATION_STAGES + 1]);
  return 0;
}
"""


def stability(z: complex) -> complex:
    return complex((1 + 2 * z / 5 + z**2 / 20) / (1 - 3 * z / 5 + 3 * z**2 / 20 - z**3 / 60))


@pytest.mark.parametrize("stiffness", [4.0, 1e12])
def test_a_step_multiplies_a_linear_motion_by_the_stability_function(
    stiffness: float, tmp_path: Path
) -> None:
    said = run_c(MAIN, tmp_path, f"-DSTIFFNESS={stiffness}", *options_for(1, False))
    place, speed, error, evaluations, rate, slope = map(float, said.split())
    w = np.sqrt(stiffness)
    expected = stability(0.1j * w)
    assert place == pytest.approx(expected.real, abs=1e-12)
    assert speed == pytest.approx(-w * expected.imag, abs=1e-12 * w)
    assert evaluations <= 9  # of a linear motion the first correction is right, up to rounding
    assert rate == pytest.approx(speed, abs=1e-11 * w)
    assert slope == pytest.approx(-stiffness * place, abs=1e-11 * stiffness)
    assert error > 0.0


def test_a_step_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    said = run_c(MAIN, tmp_path, "-DSTIFFNESS=(double)NAN", *options_for(1, False))
    assert float(said.split()[2]) == np.inf


def test_vibrations_lose_as_much_a_step_as_the_record_says() -> None:
    factor, power = find_row("radau", True).vibration_loss
    for angle in np.linspace(0.3, 4.0, 13):
        changed = abs(stability(1j * angle) - np.exp(1j * angle))
        assert 1 / 3 < changed / (factor * angle**power) < 3
