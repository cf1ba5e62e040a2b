#ifndef FIRST_STEP_H
#define FIRST_STEP_H
#include "config.h"

/* Displace coordinates (round 0: every way, 1: along what that changed in the accelerations) or velocities (round 2)
 * by an amount that is small beside them and large beside their rounding. `found`: derivative at the last displaced
 * state. States lie `stride` apart. */
static inline void motion_displace(
    int stride, int round, const real *state, const real *rate, const real *found, real *moved)
{
  const int first = round == 2 ? N : 0;
  double size = 0.0, steepest = 0.0;
  int k;
  for (k = 0; k < N_STATES; ++k) {
    moved[k * stride] = state[k * stride];
  }
  for (k = 0; k < N; ++k) {
    const double x = fabs((double)state[(first + k) * stride]), a = fabs((double)rate[(N + k) * stride]);
    size = fmax(size, round == 2 ? x + a : x);
    steepest = fmax(steepest, fabs((double)found[(N + k) * stride] - (double)rate[(N + k) * stride]));
  }
#if WITH_FLOAT
  size = 5e-5 * (size > 0.0 ? size : 1.0);
#else
  size = 4e-10 * (size > 0.0 ? size : 1.0);
#endif
  for (k = 0; k < N; ++k) {
    /* Multiples of the golden ratio, modulo 1: no two modes of a structure look like that. */
    const double turns = 0.6180339887498949 * (k + 1), golden = turns - (double)(long)turns - 0.4;
    const double change = (double)found[(N + k) * stride] - (double)rate[(N + k) * stride];
    moved[(first + k) * stride] += (real)(size * (round == 1 && steepest > 0.0 ? change / steepest : golden));
  }
}

/* By how much accelerations change for a unit of the displacement, at most; 0 if that is not finite. */
static inline double motion_response(
    int stride, const real *state, const real *rate, const real *moved, const real *found)
{
  double moved_by = 0.0, changed_by = 0.0;
  int k;
  for (k = 0; k < 2 * N; ++k) {
    moved_by = fmax(moved_by, fabs((double)moved[k * stride] - (double)state[k * stride]));
  }
  for (k = N; k < 2 * N; ++k) {
    const double change = (double)found[k * stride] - (double)rate[k * stride];
    changed_by = change - change == 0.0 ? fmax(changed_by, fabs(change)) : INFINITY;
  }
  return changed_by < INFINITY && moved_by > 0.0 ? changed_by / moved_by : 0.0;
}

/* A first step that resolves the fastest motion, `fastest` [1/s]: the tighter the tolerance the shorter, so that no two
 * runs begin with the same error; wherever the origin lies. `order`: of the error estimate. */
static inline double motion_first_step(
    int stride, double span, double rtol, double atol, double order, double fastest, const real *state,
    const real *rate)
{
  const double frequency = fmax(fastest, 1.0 / span);
  double level = fmin(1.0, fmax(rtol, 1e-16));
  int k;
  for (k = N; k < 2 * N; ++k) {
    const double change = fabs((double)rate[k * stride]) / frequency;
    const double scale = atol + rtol * fabs((double)state[k * stride]);
    level = scale < level * change ? scale / change : level;
  }
  return fmin(span, 2.0 * pow(level, 1.0 / order) / frequency);
}

#endif
