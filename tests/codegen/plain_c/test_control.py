"""The controller in plain C: intervals, motions, mass matrices, and a closed loop of the sample."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.codegen.plain_c.alone import options_for, run_c

INTERVALS = r"""
#include <stdio.h>
#include "control/motion.h"
int main(void)
{
  static const real knot[4] = {0, 1, 3, 4};
  static const real at[9] = {-1, 0, (real)0.5, 1, 2, 3, (real)3.5, 4, 9};
  int k;
  for (k = 0; k < 9; ++k) {
    real share;
    const int found = control_interval(knot, 4, at[k], &share);
    printf("%d %.9g\n", found, (double)share);
  }
  printf("%d\n", control_interval(knot, 2, (real)7, &(real){0}));
  return 0;
}
"""


@pytest.mark.parametrize("single", [False, True])
def test_intervals_of_knots(single: bool, tmp_path: Path) -> None:
    *rows, last = run_c(INTERVALS, tmp_path, *options_for(1, single)).splitlines()
    found = [tuple(map(float, row.split())) for row in rows]
    assert found == [(0, 0), (0, 0), (0, 0.5), (1, 0), (1, 0.5), (2, 0), (2, 0.5), (2, 1), (2, 1)]
    assert last == "0"


# q = t^5 - t^3 + 0.3 t and its derivatives at 0.1 + 0.4 k; the input is a cubic.
MOTION = r"""
#include <stdio.h>
#include "control/motion.h"
int main(void)
{
  double t;
  for (t = 0.0; t <= 1.01; t += 0.125) {
    real state[N_X], input[N_IN];
    motion_state((real)t, state);
    motion_input((real)t, input);
    printf("%.17g %.17g %.17g\n", (double)state[0], (double)state[1], (double)input[0]);
  }
  return 0;
}
"""


@pytest.mark.parametrize("single", [False, True])
def test_the_sample_moves_by_the_quintic(single: bool, tmp_path: Path) -> None:
    tolerance = 1e-6 if single else 1e-14
    said = run_c(MOTION, tmp_path, *options_for(1, single)).splitlines()
    assert len(said) == 9
    spline = CubicSpline([0.0, 1.0], [0.0, 0.2], bc_type=((1, 0.0), (1, 0.0)))
    for k, line in enumerate(said):
        t = 0.125 * k
        q, v, u = map(float, line.split())
        assert q == pytest.approx(0.1 * t**3 * (10 - 15 * t + 6 * t**2), abs=tolerance)
        assert v == pytest.approx(3.0 * t**2 * (1 - t) ** 2, abs=10 * tolerance)
        assert u == pytest.approx(float(spline(t)), abs=tolerance)


# Another matrix than that of the sample: the configuration is replaced.
MASS = r"""
#define CONTROL_CONFIG_H
#define WITH_ESTIMATOR 1
#define WITH_DISTURBANCE 1
typedef double real;
enum { N_Q = 5 };
static const int MASS_FIRST[N_Q] = {0, 0, 2, 1, 0}, MASS_ROW[N_Q] = {0, 1, 3, 4, 7};
#include <stdio.h>
#include "control/mass.h"
int main(void)
{
  /* rows from their first entries on: (4), (1 5), (6), (2 1 7), (1 0 2 -1 8) */
  double mass[12] = {4, 1, 5, 6, 2, 1, 7, 1, 0, 2, -1, 8}, x[5] = {1, 2, 3, 4, 5};
  double flat[12] = {4, 1, 5, 6, 2, 1, 7, 1, 0, 2, -1, -8}, y[5] = {1, 2, 3, 4, 5};
  int k;
  printf("%d\n", mass_solve(mass, x));
  for (k = 0; k < N_Q; ++k) printf("%.17g\n", x[k]);
  printf("%d\n", mass_solve(flat, y));
  return 0;
}
"""


def test_mass_matrices_are_solved_in_their_envelope(tmp_path: Path) -> None:
    matrix = np.array(
        [[4, 1, 0, 0, 1], [1, 5, 0, 2, 0], [0, 0, 6, 1, 2], [0, 2, 1, 7, -1], [1, 0, 2, -1, 8.0]]
    )
    found = run_c(MASS, tmp_path, f"-I{options_for(1, False)[-1][2:]}").split()
    assert found[0] == "1"
    assert np.array(found[1:6], dtype=float) == pytest.approx(
        np.linalg.solve(matrix, [1, 2, 3, 4, 5]), rel=1e-13
    )
    assert found[6] == "0"


LOOP = r"""
#include <stdio.h>
#include "control/step.h"
int main(void)
{
  static scene_control c;
  real x[2] = {(real)0.005, 0}, length, rest;
  int k, status = control_init(&c, NULL), limited = 0;
  real before;
  for (k = 0; k < 400; ++k) {
    int j;
    length = (real)1.0 + x[0];
    before = c.command[0];
    status = control_step_at(&c, (real)k * CONTROL_SAMPLE, &length, NULL, &rest);
    limited += status != SCENE_CONTROL_OK;
    if (c.command[0] - before > (real)0.0100001 || before - c.command[0] > (real)0.0100001) return 1;
    for (j = 0; j < 10; ++j) { /* the command arrives after 14 ms; here at once after 10 */
      real a;
      control_acceleration(x, x + 1, c.input, &a);
      x[0] += CONTROL_SAMPLE / 10 * x[1];
      x[1] += CONTROL_SAMPLE / 10 * (a + (real)0.5);
    }
  }
  printf("%d %.9g %.9g %.9g %.9g\n", limited, (double)x[0], (double)rest, (double)c.command[0],
         (double)c.disturbance[0]);
  status = control_step_next(&c, &length, NULL, &rest);
  status += control_step_next(&c, NULL, x, &rest);
  status += control_step_next(&c, NULL, NULL, &rest) == SCENE_CONTROL_NULL_POINTER ? 0 : 100;
  printf("%d\n", status);
  return 0;
}
"""


@pytest.mark.parametrize("single", [False, True])
def test_the_sample_is_held_against_a_constant_force(single: bool, tmp_path: Path) -> None:
    """0.5 N, which the estimator finds, and the sums of feedback take away."""
    said = run_c(LOOP, tmp_path, *options_for(1, single)).splitlines()
    _, place, rest, command, force = map(float, said[0].split())
    assert place == pytest.approx(0.1, abs=1e-3)
    assert rest == pytest.approx(1.0 + command, rel=1e-6)
    assert force == pytest.approx(0.5, rel=0.05)
    assert said[1] == "0"
