"""Dense output by quintic Hermite interpolation, in C."""

from pathlib import Path

import pytest

from tests.codegen.plain_c.alone import options_for, run_c

# x = t^5 / 20 over [1, 1.5]: velocity t^4 / 4, acceleration t^3.
MAIN = """
#include <stdio.h>
#include "interpolate.h"
int main(void)
{
  const real t0 = 1, t1 = (real)1.5, h = t1 - t0;
  const real old[3] = {(real)0.05, (real)0.25, 1};
  const real q1 = t1 * t1 * t1 * t1 * t1 / 20, v1 = t1 * t1 * t1 * t1 / 4, a1 = t1 * t1 * t1;
  int k;
  for (k = 0; k <= 4; ++k) {
    real out[2];
    motion_interpolate((real)k / 4, h, old, &q1, &v1, &a1, out);
    printf("%.17g %.17g\\n", (double)out[0], (double)out[1]);
  }
  return 0;
}
"""


@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
def test_polynomials_of_degree_five_are_met(single: bool, tmp_path: Path) -> None:
    lines = run_c(MAIN, tmp_path, *options_for(1, single)).splitlines()
    for k, line in enumerate(lines):
        t = 1 + 0.5 * k / 4
        place, speed = map(float, line.split())
        assert place == pytest.approx(t**5 / 20, rel=1e-6 if single else 1e-15)
        assert speed == pytest.approx(t**4 / 4, rel=1e-5 if single else 1e-14)
    assert len(lines) == 5
