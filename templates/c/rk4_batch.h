#ifndef RK4_BATCH_H
#define RK4_BATCH_H
#include "batch_config.h"

enum { RK4_ROW = (7 * N + LINE - 1) / LINE * LINE }; /* old (q, v, a), new (q, v, a), spare */

/* One step of all lanes from (q, v) with acceleration a to `trial`, with its acceleration in a4. */
static inline void rk4_step_lanes(
    const motion_batch *m, real h, const real *TENSEGRITY_RESTRICT state, const real *TENSEGRITY_RESTRICT a,
    real *TENSEGRITY_RESTRICT trial, real *TENSEGRITY_RESTRICT stage)
{
  const real *q = state, *v = state + N * WIDTH;
  real *qs = stage, *v2 = stage + N * WIDTH, *v3 = stage + 2 * N * WIDTH, *v4 = stage + 3 * N * WIDTH;
  real *a2 = stage + 4 * N * WIDTH, *a3 = stage + 5 * N * WIDTH, *a4 = stage + 6 * N * WIDTH;
  const real half = (real)0.5 * h, sixth = h / (real)6.0;
  int k;
  /* Stages at t + h/2, t + h/2 and t + h, each from the slopes (v, a) of the one before. */
  for (k = 0; k < N * WIDTH; ++k) {
    qs[k] = q[k] + half * v[k];
    v2[k] = v[k] + half * a[k];
  }
  motion_slope_lanes(m, qs, v2, a2);
  for (k = 0; k < N * WIDTH; ++k) {
    qs[k] = q[k] + half * v2[k];
    v3[k] = v[k] + half * a2[k];
  }
  motion_slope_lanes(m, qs, v3, a3);
  for (k = 0; k < N * WIDTH; ++k) {
    qs[k] = q[k] + h * v3[k];
    v4[k] = v[k] + h * a3[k];
  }
  motion_slope_lanes(m, qs, v4, a4);
  /* x + h/6 (k1 + 2 k2 + 2 k3 + k4) */
  for (k = 0; k < N * WIDTH; ++k) {
    trial[k] = q[k] + sixth * (v[k] + (real)2.0 * (v2[k] + v3[k]) + v4[k]);
    trial[N * WIDTH + k] = v[k] + sixth * (a[k] + (real)2.0 * (a2[k] + a3[k]) + a4[k]);
  }
#if WITH_CONSTRAINTS
  motion_project_lanes(m, trial, trial + N * WIDTH, stage);
#endif
  motion_slope_lanes(m, trial, trial + N * WIDTH, a4);
}

/* The samples of lane k up to t1, on a step from `state` with acceleration a to `trial` with acceleration a1. */
static inline void rk4_sample_lane(
    const motion_batch *m, const batch_call *call, int k, double t0, double t1, double step, const real *state,
    const real *a, const real *trial, const real *a1)
{
  const motion_samples to = motion_samples_of(call, k);
  real *old = m->row, *end = m->row + 3 * N;
  motion_lane(state, 2 * N, k, old);
  motion_lane(a, N, k, old + 2 * N);
  motion_lane(trial, 2 * N, k, end);
  motion_lane(a1, N, k, end + 2 * N);
  for (; motion_next_sample(&to) <= t1; ++*to.n_filled) {
    const real s = (real)((motion_next_sample(&to) - t0) / step);
    real *sample = to.state + *to.n_filled * 2 * N;
    motion_interpolate(s, (real)step, old, end, end + N, end + 2 * N, sample);
#if WITH_CONSTRAINTS
    motion_project(sample, sample + N, m->with + k, m->row + 6 * N);
#endif
  }
}

/* Take the lanes whose step is finite; the others stop with a status. Returns how many stop. */
static inline int rk4_choose_lanes(
    const real *trial, const real *a1, const batch_call *call, motion_batch *m, real *TENSEGRITY_RESTRICT take)
{
  real probe[WIDTH];
  int j, k, n_stopped = 0;
  for (k = 0; k < WIDTH; ++k) {
    probe[k] = (real)0.0;
  }
  for (j = 0; j < N; ++j) {
    for (k = 0; k < WIDTH; ++k) {
      const real x = trial[j * WIDTH + k], y = trial[(N + j) * WIDTH + k], z = a1[j * WIDTH + k];
      probe[k] += (x - x) + (y - y) + (z - z);
    }
  }
  for (k = 0; k < WIDTH; ++k) {
    take[k] = m->runs[k] && probe[k] == (real)0.0 ? (real)1.0 : (real)0.0;
    if (m->runs[k] && take[k] == (real)0.0) {
      call->status[k] = SCENE_NON_FINITE_RESULT;
      m->runs[k] = 0;
      ++n_stopped;
    }
  }
  return n_stopped;
}

/* Steps first_step to first_step + n_steps - 1 of all lanes; n_done: how many of each were done. */
static inline int rk4_advance_lanes(
    double time_start, double step, long long first_step, long long n_steps, const batch_call *call, long long *n_done,
    motion_batch *m, real *work)
{
  real *now, *trial, *a, *stage, *a1, take[WIDTH];
  long long i;
  int k, n_good = 0;
  if (motion_find_sources(call, m) == 0) {
    return motion_gather(m, work, call);
  }
  now = motion_lay_out_batch(work, m) + RK4_ROW;
  trial = now + 2 * N * WIDTH;
  a = trial + 2 * N * WIDTH;
  stage = a + N * WIDTH;
  a1 = stage + 6 * N * WIDTH;
  motion_spread(m, call->state, 2 * N, 2 * N, now);
  motion_slope_lanes(m, now, now + N * WIDTH, a);
  for (k = 0; k < call->n_batch; ++k) {
    if (m->runs[k]) {
      motion_lane(a, N, k, m->row);
      m->runs[k] = all_finite(m->row, N);
      call->status[k] = m->runs[k] ? SCENE_OK : SCENE_NON_FINITE_RESULT;
      n_good += m->runs[k];
    }
  }
  for (i = 0; i < n_steps && n_good > 0; ++i) {
    const double t0 = time_start + ((double)first_step + (double)i) * step;
    const double t1 = time_start + ((double)first_step + (double)i + 1.0) * step;
    rk4_step_lanes(m, (real)step, now, a, trial, stage);
    n_good -= rk4_choose_lanes(trial, a1, call, m, take);
    for (k = 0; k < WIDTH; ++k) {
      if (m->runs[k]) {
        n_done[k] = i + 1;
        if (call->n_sampled[k] < call->n_samples && call->sample_time[call->n_sampled[k]] <= t1) {
          rk4_sample_lane(m, call, k, t0, t1, step, now, a, trial, a1);
        }
      }
    }
    motion_blend(take, trial, 2 * N, now);
    motion_blend(take, a1, N, a);
  }
  return motion_gather(m, now, call);
}

#endif
