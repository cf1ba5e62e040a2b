"""The integrator radau in C: one mass on one bar, whose tension is an unknown."""

import math
from pathlib import Path

import pytest

from tests.cases import thorough
from tests.codegen.plain_c.alone import options_for, run_c

# One coordinate, eliminated before the multiplier of the bar from it to the origin.
MAIN = r"""
#include <stdio.h>
#include <string.h>
#include "radau.h"
const int radau_elimination_row[2] = {0, 1};
const int radau_entry_start[3] = {0, 0, 1}, radau_entry_column[1] = {0};
const int radau_factor_start[3] = {0, 0, 1}, radau_factor_column[1] = {0};
const int radau_row[1] = {1};
const int radau_update_start[2] = {0, 0}, radau_update_row[1] = {0}, radau_update_entry[1] = {0};
const int radau_mass_entry[1] = {-1};
const int scene_radau_member[1] = {0};
const int radau_coordinate[2] = {0, -1}, radau_direction_entry[2] = {0, -1};
int main(void)
{
  static radau_work work;
  double state[2] = {1.2, 0.0}, sample[3][2], tension[3], vibration[3], time = 0.0, step = 0.0;
  const double stiffness = STIFFNESS, at[3] = {0.0, 0.5, 1.0};
  const motion_arguments with = {&stiffness, NULL};
  long long n_sampled = 0, count[RADAU_COUNTS] = {0};
  int k, status;
  memset(&work, 255, sizeof work); /* NAN: nothing may be read before it is written */
  work.with = &with;
  work.rtol = 1e-9;
  work.atol = 1e-9;
  status = radau_advance(
      1.0, 100000, 0.0, &time, &step, state,
      3, at, &sample[0][0], tension, &n_sampled, count, vibration, NULL, &work);
  for (k = 0; k < 3; ++k) printf("%.17g %.17g %.17g\n", sample[k][0], sample[k][1], tension[k]);
  printf("%lld %.17g\n", n_sampled, time);
  return status;
}
"""


@pytest.mark.parametrize("stiffness", [900.0, *thorough(4.0)])
def test_a_mass_on_a_bar_vibrates(stiffness: float, tmp_path: Path) -> None:
    said = run_c(MAIN, tmp_path, f"-DSTIFFNESS={stiffness}", *options_for(1, False))
    *samples, end = ([float(word) for word in line.split()] for line in said.splitlines())
    assert end == [3, 1.0]
    frequency = math.sqrt(stiffness)
    for t, (place, speed, tension) in zip((0.0, 0.5, 1.0), samples, strict=True):
        stretch = 0.2 * math.cos(frequency * t)
        assert place == pytest.approx(1 + stretch, abs=1e-6)
        assert speed == pytest.approx(-0.2 * frequency * math.sin(frequency * t), abs=1e-6 * stiffness)
        assert tension == pytest.approx(stiffness * stretch, abs=1e-5 * stiffness)
