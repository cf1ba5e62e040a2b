#ifndef SAMPLE_H
#define SAMPLE_H
#include "columns.h"
#include "interpolate.h"

/* Samples that a caller asks for: ascending times, one state of 2 * N a time, and how many are filled. */
typedef struct {
  long long count;
  const double *time;
  real *state;
  long long *n_filled;
} motion_samples;

/* Time of the next sample; INFINITY where none is left. */
static inline double motion_next_sample(const motion_samples *to)
{
  return *to->n_filled < to->count ? to->time[*to->n_filled] : INFINITY;
}

#if WITH_INTERNAL
/* Derivative (v, a, z') of the state (q, v, z). */
static inline void motion_rate(const real *state, const motion_arguments *with, real *rate)
{
#if WITH_COLUMNS
  motion_column_rate(state, state + N, with, rate);
#else
  motion_state_derivative(state, state + N, with, rate);
#endif
}
#else
/* Derivative (v, a) of the state (q, v). */
static inline void motion_rate(const real *state, const motion_arguments *with, real *rate)
{
  int k;
  for (k = 0; k < N; ++k) {
    rate[k] = state[N + k];
  }
  motion_slope(state, state + N, with, rate + N);
}
#endif

/* Fill the samples up to t1, on a step from `old` (q, v, a) at t0 to `state` with acceleration `a`; spare: n. */
static inline void motion_sample(
    double t0, double h, double t1, const real *old, const real *state, const real *a, const motion_arguments *with,
    real *spare, const motion_samples *to)
{
  (void)with;
  (void)spare;
  for (; motion_next_sample(to) <= t1; ++*to->n_filled) {
    const double time = motion_next_sample(to);
    const real s = t1 <= time ? (real)1.0 : (real)((time - t0) / h);
    real *sample = to->state + *to->n_filled * N_STATES;
    motion_interpolate(s, (real)h, old, state, state + N, a, sample);
#if WITH_CONSTRAINTS
#if WITH_PROFILE
    profile_set_time(time, with->profile);
#endif
    motion_project(sample, sample + N, with, spare);
#endif
  }
}

#endif
