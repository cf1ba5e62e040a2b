#ifndef EXPLICIT_BATCH_H
#define EXPLICIT_BATCH_H
#include "explicit.h"
#include "tableau_batch.h"

/* Explicit methods with step control for a batch: every lane takes steps of its own. */

/* Numbers of single rows: old (q, v, a), new (q, v), derivative, spare, dense output. */
#if METHOD_HAS_DENSE
enum { METHOD_ROW = (N_OLD + 2 * N_STATES + N + N_STATES * METHOD_DENSE + LINE - 1) / LINE * LINE };
#else
enum { METHOD_ROW = (N_OLD + 2 * N_STATES + N + LINE - 1) / LINE * LINE };
#endif

/* Where the lanes of one integration lie in the work memory. Kept between calls: may_grow (whether the next step may be
 * longer), lost (what rounding has taken from the state), rates and state. Then change and state of a trial step. */
typedef struct {
  real *may_grow, *lost, *rates, *state, *change, *trial, *spare;
#if METHOD_HAS_DENSE
  real *dense;
#endif
} method_lanes;

/* Integrations up to a time, each with steps of its own; count: steps taken, rejected and evaluations of each. */
typedef struct {
  double time_end, rtol, atol;
  double *time, *step;
  long long *count;
  const batch_call *call;
} method_batch;

/* Stop a lane with a status. */
static inline void method_stop_lane(const method_batch *b, int k, int status, motion_batch *m)
{
  b->call->status[k] = status;
  m->runs[k] = 0;
}

#if METHOD_HAS_LATE_END
/* Evaluate derivatives at the ends of steps that keep the tolerance; where these are not finite, the error
 * becomes infinite. */
static inline void method_evaluate_end_lanes(
    const motion_batch *m, const real *trial, real *rate, long long *count, double *error)
{
  int j, k, any = 0;
  for (k = 0; k < WIDTH; ++k) {
    any = any || (m->runs[k] && error[k] <= 1.0);
  }
  if (!any) {
    return;
  }
  motion_rate_lanes(m, trial, rate);
  for (k = 0; k < WIDTH; ++k) {
    if (m->runs[k] && error[k] <= 1.0) {
      ++count[3 * k + 2];
      for (j = 0; j < N_STATES; ++j) {
        const real x = rate[j * WIDTH + k];
        error[k] = x - x == (real)0.0 ? error[k] : INFINITY;
      }
    }
  }
}

#endif
/* The samples of lane k on its step of length h to time `t1`, which has been accepted. */
static inline void method_sample_lane(
    const method_batch *b, const motion_batch *m, const method_lanes *l, int k, double h, double t1)
{
  const motion_samples to = motion_samples_of(b->call, k);
  const double t0 = b->time[k];
  real *old = m->row, *end = m->row + N_OLD, *rate = m->row + N_OLD + N_STATES, *spare = m->row + N_OLD + 2 * N_STATES;
  motion_lane(l->state, N_STATES, k, old);
  motion_lane(l->rates + N * WIDTH, N_SLOPES, k, old + N_STATES);
  motion_lane(l->trial, N_STATES, k, end);
  motion_lane(l->rates + N_STATES * WIDTH * METHOD_STAGES, N_STATES, k, rate);
#if METHOD_HAS_DENSE
  if (motion_next_sample(&to) < t1) {
    real *dense = m->row + N_OLD + 2 * N_STATES + N;
    b->count[3 * k + 2] += METHOD_DENSE_ROWS;
    motion_lane(l->dense, N_STATES * METHOD_DENSE, k, dense);
    method_sample_dense(t0, h, t1, old, dense, m->with + k, spare, &to);
  }
#endif
  motion_sample(t0, h, t1, old, end, rate + N, m->with + k, spare, &to);
}

/* Choose first steps in the lanes that `choose`, from how accelerations answer to small displacements. */
static inline void method_choose_steps(
    const method_batch *b, const motion_batch *m, const method_lanes *l, const real *choose)
{
  double fastest[WIDTH] = {0.0};
  int i, k;
#if WITH_VELOCITY
  const int rounds = 3;
#else
  const int rounds = 2;
#endif
  for (i = 0; i < rounds; ++i) {
    for (k = 0; k < WIDTH; ++k) {
      motion_displace(WIDTH, i, l->state + k, l->rates + k, (i ? l->change : l->rates) + k, l->trial + k);
    }
    motion_rate_lanes(m, l->trial, l->change);
    for (k = 0; k < WIDTH; ++k) {
      const double found = motion_response(WIDTH, l->state + k, l->rates + k, l->trial + k, l->change + k);
      fastest[k] = fmax(fastest[k], i == 2 ? found : sqrt(found));
    }
  }
  for (k = 0; k < WIDTH; ++k) {
    if (m->source[k] == k && choose[k] > (real)0.0) {
      b->count[3 * k + 2] += rounds;
      b->step[k] = motion_first_step(
          WIDTH, b->time_end - b->time[k], b->rtol, b->atol, METHOD_ERROR_ORDER, fastest[k], l->state + k,
          l->rates + k);
    }
  }
}

/* Begin in the lanes that have counted nothing yet; those that fail stop. Returns how many go on. */
static inline int method_begin_lanes(const method_batch *b, motion_batch *m, const method_lanes *l)
{
  real *rate = m->row + N_OLD + N_STATES, is_new[WIDTH];
  int j, k, any = 0, n_left = 0;
  for (k = 0; k < WIDTH; ++k) {
    const long long *own = b->count + 3 * m->source[k];
    const int is_own = k < b->call->n_batch && m->source[k] == k;
    is_new[k] = !is_own || own[0] + own[1] + own[2] == 0 ? (real)1.0 : (real)0.0;
    any = any || (is_new[k] > (real)0.0 && m->source[k] == k);
    if (is_new[k] > (real)0.0) {
      l->may_grow[k] = (real)1.0;
      for (j = 0; j < N_STATES; ++j) {
        l->lost[j * WIDTH + k] = (real)0.0;
      }
    }
  }
  if (any) {
    motion_rate_lanes(m, l->state, l->trial);
    motion_blend(is_new, l->trial, N_STATES, l->rates);
  }
  for (k = 0; k < WIDTH; ++k) {
    if (m->source[k] != k) {
      for (j = 0; j < N_STATES; ++j) {
        l->rates[j * WIDTH + k] = l->rates[j * WIDTH + m->source[k]];
      }
    } else if (is_new[k] > (real)0.0) {
      b->count[3 * k + 2] = 1;
      motion_lane(l->rates, N_STATES, k, rate);
      if (!all_finite(rate, N_STATES)) {
        method_stop_lane(b, k, SCENE_NON_FINITE_RESULT, m);
      }
      is_new[k] = m->runs[k] && !(b->step[k] > 0.0) ? (real)1.0 : (real)0.0;
    }
  }
  if (any) {
    method_choose_steps(b, m, l, is_new);
  }
  for (k = 0; k < WIDTH; ++k) {
    m->runs[k] = m->runs[k] && b->time[k] < b->time_end;
    n_left += m->runs[k];
  }
  return n_left;
}

/* The steps of all lanes, h, and where they end; a lane whose step no number resolves stops. */
static inline void method_plan_lanes(const method_batch *b, motion_batch *m, double *h, double *t1, real *span)
{
  int k;
  for (k = 0; k < WIDTH; ++k) {
    span[k] = (real)0.0;
    h[k] = 0.0;
    if (m->runs[k]) {
      const double left = b->time_end - b->time[k];
      h[k] = b->step[k] >= left ? left : b->step[k];
      t1[k] = b->step[k] >= left ? b->time_end : b->time[k] + h[k];
#if WITH_FLOAT
      /* A float holds no step beyond 1e38, which is tried again shorter. */
      if (h[k] < SMALLEST_STEP) {
        method_stop_lane(b, k, SCENE_STEP_TOO_SMALL, m);
      }
      span[k] = h[k] < 1e38 ? (real)h[k] : (real)0.0;
#else
      span[k] = h[k];
#endif
    }
  }
}

/* Choose the next step of lane k after one of length h with this scaled error; non-zero if that is taken. */
static inline int method_choose_next_step(
    const method_batch *b, int k, double h, double error, motion_batch *m, const method_lanes *l)
{
  b->count[3 * k + 2] += METHOD_EVALUATIONS;
  if (error <= 1.0) {
    ++b->count[3 * k];
    /* Do not let the last step set the pace, nor grow right after a rejection. */
    if (b->step[k] < b->time_end - b->time[k]) {
      b->step[k] = step_after_success(h, error, METHOD_ERROR_ORDER, l->may_grow[k] > (real)0.0);
    }
    l->may_grow[k] = (real)1.0;
    return 1;
  }
  ++b->count[3 * k + 1];
  b->step[k] = step_after_rejection(h, error, METHOD_ERROR_ORDER);
  l->may_grow[k] = (real)0.0;
  if (b->step[k] <= 4e-16 * fabs(b->time[k]) || b->step[k] < SMALLEST_STEP) {
    method_stop_lane(b, k, error < INFINITY ? SCENE_STEP_TOO_SMALL : SCENE_NON_FINITE_RESULT, m);
  }
  return 0;
}

/* One trial step in every lane. Returns how many lanes go on. */
static inline int method_trial_lanes(const method_batch *b, motion_batch *m, const method_lanes *l)
{
  real span[WIDTH], take[WIDTH], *end = l->rates + N_STATES * WIDTH * METHOD_STAGES;
  double h[WIDTH], t1[WIDTH], error[WIDTH];
  const batch_call *call = b->call;
  int j, k, n_left = 0;
#if METHOD_HAS_DENSE
  int is_between = 0;
#endif
  method_plan_lanes(b, m, h, t1, span);
  method_try_lanes(m, span, b->rtol, b->atol, l->state, l->lost, l->rates, l->change, l->trial, error);
  for (j = 0; j < N_STATES * WIDTH; ++j) {
    l->change[j] -= l->trial[j] - l->state[j];
  }
#if WITH_CONSTRAINTS
  motion_project_lanes(m, l->trial, l->trial + N * WIDTH, l->spare);
#endif
#if METHOD_HAS_LATE_END
  method_evaluate_end_lanes(m, l->trial, end, b->count, error);
#endif
  for (k = 0; k < WIDTH; ++k) {
    take[k] = (real)0.0;
    if (m->runs[k]) {
#if WITH_FLOAT
      error[k] = h[k] < 1e38 ? error[k] : INFINITY;
#endif
      take[k] = method_choose_next_step(b, k, h[k], error[k], m, l) ? (real)1.0 : (real)0.0;
#if METHOD_HAS_DENSE
      is_between = is_between || (take[k] > (real)0.0 && call->n_sampled[k] < call->n_samples
          && call->sample_time[call->n_sampled[k]] < t1[k]);
#endif
    }
  }
#if METHOD_HAS_DENSE
  if (is_between) {
    method_prepare_lanes(m, span, l->state, l->trial, l->spare, l->rates, l->dense);
  }
#endif
  for (k = 0; k < WIDTH; ++k) {
    if (take[k] > (real)0.0) {
      if (call->n_sampled[k] < call->n_samples && call->sample_time[call->n_sampled[k]] <= t1[k]) {
        method_sample_lane(b, m, l, k, h[k], t1[k]);
      }
      b->time[k] = t1[k];
      m->runs[k] = b->time[k] < b->time_end;
    }
    n_left += m->runs[k];
  }
  motion_blend(take, l->trial, N_STATES, l->state);
  motion_blend(take, l->change, N_STATES, l->lost);
  motion_blend(take, end, N_STATES, l->rates);
  return n_left;
}

/* On to time_end in all lanes, in at most so many trial steps. */
static inline int method_advance_lanes(const method_batch *b, long long most_steps, motion_batch *m, real *work)
{
  const int size = N_STATES * WIDTH;
  method_lanes l;
  long long i;
  int n_left;
  if (motion_find_sources(b->call, m) == 0) {
    return motion_gather(m, work, b->call);
  }
  l.may_grow = motion_lay_out_batch(work, m) + METHOD_ROW;
  l.lost = l.may_grow + WIDTH;
  l.rates = l.lost + size;
  l.state = l.rates + size * METHOD_RATES;
  l.change = l.state + size;
  l.trial = l.change + size;
  l.spare = l.trial + size;
#if METHOD_HAS_DENSE
  l.dense = l.spare + size;
#endif
  motion_spread(m, b->call->state, N_STATES, N_STATES, l.state);
  n_left = method_begin_lanes(b, m, &l);
  for (i = 0; i < most_steps && n_left > 0; ++i) {
    n_left = method_trial_lanes(b, m, &l);
  }
  return motion_gather(m, l.state, b->call);
}

#endif
