#ifndef RK4_H
#define RK4_H
#include "finite.h"
#include "sample.h"

/* Memory of one integration. */
typedef struct {
  real a[N], old[3 * N], trial[2 * N], stage[7 * N];
} rk4_work;

/* One step from (q, v) with acceleration a; leaves the new state in q, v and its acceleration in a. */
static inline void rk4_step(real h, real *q, real *v, real *a, const motion_arguments *with, real *stage)
{
  real *qs = stage, *v2 = stage + N, *v3 = stage + 2 * N, *v4 = stage + 3 * N;
  real *a2 = stage + 4 * N, *a3 = stage + 5 * N, *a4 = stage + 6 * N;
  const real half = (real)0.5 * h, sixth = h / (real)6.0;
  int k;
  /* Stages at t + h/2, t + h/2 and t + h, each from the slopes (v, a) of the one before. */
  for (k = 0; k < N; ++k) {
    qs[k] = q[k] + half * v[k];
    v2[k] = v[k] + half * a[k];
  }
  motion_slope(qs, v2, with, a2);
  for (k = 0; k < N; ++k) {
    qs[k] = q[k] + half * v2[k];
    v3[k] = v[k] + half * a2[k];
  }
  motion_slope(qs, v3, with, a3);
  for (k = 0; k < N; ++k) {
    qs[k] = q[k] + h * v3[k];
    v4[k] = v[k] + h * a3[k];
  }
  motion_slope(qs, v4, with, a4);
  /* x + h/6 (k1 + 2 k2 + 2 k3 + k4) */
  for (k = 0; k < N; ++k) {
    q[k] += sixth * (v[k] + (real)2.0 * (v2[k] + v3[k]) + v4[k]);
    v[k] += sixth * (a[k] + (real)2.0 * (a2[k] + a3[k]) + a4[k]);
  }
#if WITH_CONSTRAINTS
  motion_project(q, v, with, stage);
#endif
  motion_slope(q, v, with, a);
}

/* Steps first_step to first_step + n_steps - 1 from `state`; n_done: how many were done. */
static inline int rk4_advance(
    double time_start, double step, long long first_step, long long n_steps, real *state, const motion_arguments *with,
    const motion_samples *to, long long *n_done, rk4_work *w)
{
  long long i;
  int k;
  motion_slope(state, state + N, with, w->a);
  if (!all_finite(w->a, N)) {
    return SCENE_NON_FINITE_RESULT;
  }
  for (i = 0; i < n_steps; ++i) {
    const double t0 = time_start + ((double)first_step + (double)i) * step;
    const double t1 = time_start + ((double)first_step + (double)i + 1.0) * step;
    for (k = 0; k < 2 * N; ++k) {
      w->old[k] = state[k];
      w->trial[k] = state[k];
    }
    for (k = 0; k < N; ++k) {
      w->old[2 * N + k] = w->a[k];
    }
    rk4_step((real)step, w->trial, w->trial + N, w->a, with, w->stage);
    if (!all_finite(w->trial, 2 * N) || !all_finite(w->a, N)) {
      return SCENE_NON_FINITE_RESULT;
    }
    for (k = 0; k < 2 * N; ++k) {
      state[k] = w->trial[k];
    }
    for (; motion_next_sample(to) <= t1; ++*to->n_filled) {
      const real s = (real)((motion_next_sample(to) - t0) / step);
      real *sample = to->state + *to->n_filled * 2 * N;
      motion_interpolate(s, (real)step, w->old, state, state + N, w->a, sample);
#if WITH_CONSTRAINTS
      motion_project(sample, sample + N, with, w->stage);
#endif
    }
    *n_done = i + 1;
  }
  return SCENE_OK;
}

#endif
