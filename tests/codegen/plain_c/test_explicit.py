"""The loop of explicit methods in C, with Heun's method of the sample: oscillators, an event, the energy."""

import math
from pathlib import Path

import pytest

from tests.cases import thorough
from tests.codegen.plain_c.alone import options_for, run_c

# N masses, each on a spring of stiffness 4: they begin at 1, 1/2, 1/3 ... at rest.
MAIN = """
#include <stdio.h>
#include <string.h>
#include "explicit.h"
#include "rk4.h"
static double later(double time, const double *q, const double *v, void *data)
{
  (void)q;
  (void)v;
  (void)data;
  return time - 0.3;
}
int main(void)
{
  static method_work work;
  static rk4_work fixed;
  static real state[2 * N], sample[5][2 * N];
  const real stiffness = 4;
  const double at[5] = {0.0, 0.25, 0.5, 0.75, 1.0};
  const motion_arguments with = {&stiffness, NULL};
  long long n_filled = 0, n_done = 0;
  const motion_samples to = {5, at, &sample[0][0], &n_filled};
  scene_run run;
  double time = 0.0, step = 0.0;
  method_motion m;
  int k, status = 0;
  memset(&run, 0, sizeof run);
  m.rtol = m.atol = RTOL;
  m.time = &time;
  m.step = &step;
  m.state = state;
  m.with = &with;
  m.to = &to;
  m.run = &run;
  m.work = &work;
  for (k = 0; k < N; ++k) state[k] = (real)1 / (real)(k + 1);
  (void)later;
  (void)fixed;
  (void)n_done;
  BODY
  return status;
}
"""

WHOLE = "status = method_advance(1.0, 1000000, &m);"
SAY_SAMPLES = r"""
  for (k = 0; k < 5; ++k) printf("%.17g %.17g\n", (double)sample[k][0], (double)sample[k][2 * N - 1]);
  printf("%lld %.17g\n", n_filled, time);
"""


def run(body: str, folder: Path, n: int = 15, single: bool = False, rtol: str = "1e-7") -> list[list[float]]:
    said = run_c(MAIN.replace("BODY", body), folder, f"-DRTOL={rtol}", *options_for(n, single))
    return [[float(word) for word in line.split()] for line in said.splitlines()]


@pytest.mark.parametrize(("n", "single"), [(15, False), *thorough((1, False), (15, True))])
def test_a_linear_oscillator_is_followed(n: int, single: bool, tmp_path: Path) -> None:
    *samples, end = run(WHOLE + SAY_SAMPLES, tmp_path, n, single, "1e-4" if single else "1e-7")
    assert end == [5, 1.0]
    for k, (place, speed) in enumerate(samples):
        t = 0.25 * k
        assert place == pytest.approx(math.cos(2 * t), abs=2e-2 if single else 1e-5)
        assert speed == pytest.approx(-2 * math.sin(2 * t) / n, abs=4e-2 if single else 2e-5)


@pytest.mark.thorough
def test_calls_one_after_the_other_give_the_bits_of_one(tmp_path: Path) -> None:
    parts = "while (status == 0 && time < 1.0) status = method_advance(1.0, 3, &m);"
    assert run(parts + SAY_SAMPLES, tmp_path) == run(WHOLE + SAY_SAMPLES, tmp_path)


def test_steps_of_runge_kutta_4_have_its_order(tmp_path: Path) -> None:
    body = r"""
  for (k = 0; k < 2 && status == 0; ++k) {
    const int steps = 20 << k;
    int j;
    for (j = 0; j < 2 * N; ++j) state[j] = j == 0;
    n_filled = 5;
    status = rk4_advance(0.0, 1.0 / steps, 0, steps, state, &with, &to, &n_done, &fixed);
    printf("%.17g %lld\n", (double)state[0], n_done);
  }
"""
    (coarse, first), (fine, second) = run(body, tmp_path)
    assert (first, second) == (20, 40)
    assert (coarse - math.cos(2)) / (fine - math.cos(2)) == pytest.approx(16, rel=0.1)


def test_events_are_found_and_end_the_run(tmp_path: Path) -> None:
    """The condition changes its sign at 0.3, the first coordinate, cos 2t, at pi / 4."""
    body = r"""
  static scene_event event[4];
  run.watch = SCENE_EVENT_CABLE | SCENE_EVENT_CONDITION;
  run.stop = SCENE_EVENT_CABLE;
  run.condition = later;
  run.event = event;
  run.most_events = 4;
  status = method_advance(1.0, 1000000, &m);
  for (k = 0; k < 2; ++k) printf("%.12g %d %d\n", event[k].time, event[k].kind, event[k].direction);
  printf("%lld %d %.9g\n", run.n_events, run.is_stopped, time);
"""
    condition, cable, end = run(body, tmp_path, rtol="1e-8")
    assert condition == [pytest.approx(0.3, abs=1e-7), 4, 1]
    assert cable == [pytest.approx(math.pi / 4, abs=1e-5), 1, -1]
    assert end == [2, 1, pytest.approx(math.pi / 4, abs=1e-5)]


@pytest.mark.parametrize("n", [15, *thorough(1)])
def test_steps_end_at_the_energy_of_the_start(n: int, tmp_path: Path) -> None:
    body = r"""
  run.keeps_energy = 1;
  state[2 * N - 1] = 1.0;
  status = method_advance(1.0, 1000000, &m);
  printf("%.17g %.17g\n", run.energy, motion_energy(state, state + N, &with));
"""
    ((before, after),) = run(body, tmp_path, n, rtol="1e-3")
    assert after == pytest.approx(before, rel=1e-6)


def test_what_is_not_finite_is_said(tmp_path: Path) -> None:
    body = r"""
  state[0] = (real)INFINITY;
  printf("%d\n", method_advance(1.0, 1000000, &m) == SCENE_NON_FINITE_RESULT);
"""
    assert run(body, tmp_path) == [[1.0]]
