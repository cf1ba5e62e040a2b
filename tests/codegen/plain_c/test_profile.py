"""Arguments over time in plain C: values, kinks, checks, and motions on a spring whose stiffness changes."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.codegen.plain_c.alone import options_for, run_c

# Stiffness 4 + 8 t up to 0.3 s, then 1 + (t - 0.3)^2 up to 0.7 s, from there on 3.
HEAD = r"""
#include <stdio.h>
#include <string.h>
#include "explicit.h"
#include "radau_profile.h"
static const int place[1] = {0};
static const double at[4] = {0.0, 0.3, 0.7, 1.0};
static const double row[9] = {4, 8, 0, 1, 0, 1, 3, 0, 0};
static scene_profile knots(void)
{
  scene_profile p;
  p.n_pieces = 3;
  p.degree = 2;
  p.n_values = 1;
  p.place = place;
  p.time = at;
  p.coefficient = row;
  p.is_kink = NULL;
  return p;
}
"""

VALUES = r"""
int main(void)
{
  scene_profile p = knots();
  static const int kink[4] = {0, 0, 1, 0};
  const real constant[1] = {5};
  real value[1];
  motion_profile m;
  profile_set_time(0.5, NULL);
  profile_begin(&p, value, &m);
  printf("%g ", (double)profile_copy(constant, 1, 0, &m)[0]);
  profile_enter(0.0, &m);
  printf("%g %g ", (double)value[0], profile_kink(&m));
  profile_set_time(0.3, &m); /* up to the kink, what holds before it */
  printf("%g ", (double)value[0]);
  profile_enter(0.3, &m);
  printf("%g %g ", (double)value[0], profile_kink(&m));
  profile_set_start(0.4, &m);
  profile_set_stage(0.1, &m);
  printf("%g ", (double)value[0]);
  profile_enter(0.95, &m);
  printf("%g %d ", (double)value[0], profile_kink(&m) == INFINITY);
  p.is_kink = kink;
  profile_enter(0.1, &m);
  printf("%g ", profile_kink(&m));
  profile_set_time(0.6, &m);
  printf("%g ", (double)value[0]);
  profile_set_time(0.1, &m);
  printf("%g\n", (double)value[0]);
  return 0;
}
"""


@pytest.mark.parametrize("single", [False, True])
def test_values_hold_up_to_the_next_kink(single: bool, tmp_path: Path) -> None:
    said = run_c(HEAD + VALUES, tmp_path, *options_for(3, single)).split()
    expected = [5, 4, 0.3, 6.4, 1, 0.7, 1.04, 3, 1, 0.7, 1.09, 4.8]
    assert [float(word) for word in said] == pytest.approx(expected)


CHECKS = r"""
int main(void)
{
  static const double back[4] = {0.0, 0.3, 0.3, 1.0}, gap[9] = {4, 8, 0, 1, 0, NAN, 3, 0, 0};
  static const int far[1] = {1};
  scene_profile p = knots();
  printf("%d %d ", profile_check(&p, 1, 1, 0.0, 1.0), profile_check(&p, 1, 1, 0.5, 0.9));
  printf("%d %d ", profile_check(&p, 1, 0, -0.1, 1.0), profile_check(&p, 1, 0, 0.0, 1.1));
  printf("%d %d ", profile_check(&p, 1, 0, NAN, 1.0), profile_check(&p, 1, 0, 0.0, NAN));
  p.coefficient = gap;
  printf("%d %d ", profile_check(&p, 1, 1, 0.0, 1.0), profile_check(&p, 1, 0, 0.0, 1.0));
  p.time = back;
  printf("%d ", profile_check(&p, 1, 1, 0.0, 1.0));
  p.place = far;
  printf("%d ", profile_check(&p, 1, 1, 0.0, 1.0));
  p.place = NULL;
  printf("%d\n", profile_check(&p, 1, 1, 0.0, 1.0));
  return 0;
}
"""


def test_bad_knots_have_a_status(tmp_path: Path) -> None:
    said = run_c(HEAD + CHECKS, tmp_path, *options_for(3, False)).split()
    finite, invalid, null = "1", "3", "4"
    assert said == ["0", "0", *[invalid] * 4, finite, "0", invalid, invalid, null]


MOTION = r"""
int main(void)
{
  static method_work work;
  static real state[2 * N];
  const scene_profile p = knots();
  const real stiffness[1] = {4};
  motion_profile profile;
  motion_arguments with;
  long long n_filled = 0;
  const motion_samples to = {0, NULL, NULL, &n_filled};
  scene_run run;
  double time = 0.0, step = 0.0;
  method_motion m;
  int status = 0;
  memset(&run, 0, sizeof run);
  profile_begin(&p, work.driven, &profile);
  with.stiffness = profile_copy(stiffness, 1, 0, &profile);
  with.profile = &profile;
  m.rtol = m.atol = 1e-7;
  m.time = &time;
  m.step = &step;
  m.state = state;
  m.with = &with;
  m.to = &to;
  m.run = &run;
  m.work = &work;
  state[0] = 1;
  while (status == 0 && time < 1.0) {
    double before = time;
    status = method_follow(1.0, 1, &m);
    if (time == 0.3 || time == 0.7) printf("%g ", time);
    if ((before < 0.3 && time > 0.3) || (before < 0.7 && time > 0.7)) printf("passed ");
  }
  printf("%d %.17g %.17g\n", status, (double)state[0], (double)state[N]);
  return 0;
}
"""


@pytest.mark.thorough
def test_steps_end_at_kinks_and_follow_the_changing_stiffness(tmp_path: Path) -> None:
    *kinks, status, place, speed = map(float, run_c(HEAD + MOTION, tmp_path, *options_for(3, False)).split())
    assert (sorted(set(kinks)), status) == ([0.3, 0.7], 0)
    pieces = (lambda t: 4 + 8 * t, lambda t: 1 + (t - 0.3) ** 2, lambda _: 3.0)
    x = np.array([1.0, 0.0])
    for (start, end), k in zip(pairwise((0.0, 0.3, 0.7, 1.0)), pieces, strict=True):
        x = solve_ivp(lambda t, x, k=k: [x[1], -k(t) * x[0]], (start, end), x, rtol=1e-11, atol=1e-12).y[
            :, -1
        ]
    assert [place, speed] == pytest.approx(x.tolist(), abs=2e-5)
