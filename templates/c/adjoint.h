#ifndef ADJOINT_H
#define ADJOINT_H
#include "explicit.h"
#if WITH_ADJOINT

/* The adjoint of an explicit method: it goes back over the recorded steps of a motion and carries the derivatives of a
 * weighted sum of its samples from the end of the motion to its start, to parameters and to inputs. */

/* Memory of one pass backwards. */
typedef struct {
  real weight[N_MOVED * METHOD_RATES], rate[N_MOVED * METHOD_RATES], state[N_MOVED], rise[N_MOVED], base[N_MOVED];
  real found[N_VARIED], along[N_MOVED];
#if WITH_MARGIN_JUMPS
  real margin[N_CABLE_MARGINS], jump[N_MOVED];
#endif
#if WITH_PROFILE
  real driven[N_DRIVEN];
#endif
} method_adjoint_work;

/* The gradient of a sum of weights times states, on its way back from the end of a motion to its start. */
typedef struct {
  const motion_arguments *with;
  const double *sample_time;
  const real *sample_weight; /* (n_samples, N_MOVED) */
  long long *n_left;         /* samples before the place where it is */
  real *state_weight;        /* (N_MOVED,) derivative to the state there */
  real *number;              /* (N_DIRECTED,) to run-time parameters and inputs, as constants */
#if WITH_PROFILE
  double *coefficient; /* to the coefficients of the profile */
#endif
  method_adjoint_work *work;
} method_adjoint;

/* Add the derivatives of a rate to parameters and inputs at this time, which stand behind those to the state in `found`,
 * to the gradient. */
static inline void method_adjoin_numbers(double time, const method_adjoint *m)
{
  const real *found = m->work->found + N_MOVED;
  int k;
#if WITH_PROFILE
  const motion_profile *p = m->with->profile;
#endif
  (void)time;
  for (k = 0; k < N_DIRECTED; ++k) {
    m->number[k] += found[k];
  }
#if WITH_PROFILE
  if (p != NULL) {
    const int n = p->knots->n_values;
    for (k = 0; k < n; ++k) {
      const int row = motion_driven_row[p->knots->place[k]];
      double part = row >= 0 ? found[row] : 0.0;
      int i;
      for (i = 0; i <= p->knots->degree; ++i) {
        m->coefficient[(p->piece * (p->knots->degree + 1) + i) * n + k] += part;
        part *= time - p->knots->time[p->piece];
      }
    }
  }
#endif
}

/* Weights of the rates of a state become weights of the state, added to `to`, and of numbers. */
static inline void method_adjoin_rate(
    double time, const real *state, const real *weight, const method_adjoint *m, real *TENSEGRITY_RESTRICT to)
{
  const real *found = m->work->found;
  int k;
#if WITH_PROFILE
  profile_set_time(time, m->with->profile);
#endif
  motion_adjoint_rate(state, state + N, weight, m->with, m->work->found);
  for (k = 0; k < N_MOVED; ++k) {
    to[k] += found[k];
  }
  method_adjoin_numbers(time, m);
}

/* `sum` = `start` + h times the first rates, weighed by a row of the method. */
static inline void method_add_rates(
    real h, const real *row, int count, const real *start, const real *rate, real *TENSEGRITY_RESTRICT sum)
{
  int j, k;
  for (k = 0; k < N_MOVED; ++k) {
    sum[k] = start[k];
  }
  for (j = 0; j < count; ++j) {
    const real factor = h * row[j];
    for (k = 0; k < N_MOVED && factor != (real)0.0; ++k) {
      sum[k] += factor * rate[j * N_MOVED + k];
    }
  }
}

/* The transpose: weights of such a sum, to those of the rates. */
static inline void method_add_weights(
    real h, const real *row, int count, const real *sum, real *TENSEGRITY_RESTRICT weight)
{
  int j, k;
  for (j = 0; j < count; ++j) {
    const real factor = h * row[j];
    for (k = 0; k < N_MOVED && factor != (real)0.0; ++k) {
      weight[j * N_MOVED + k] += factor * sum[k];
    }
  }
}

#if METHOD_HAS_DENSE
/* Rates at the end of a step and of dense output, which the tape has not. */
static inline void method_complete_rates(double t0, real h, const real *old, const method_adjoint *m)
{
  method_adjoint_work *w = m->work;
  int i;
  for (i = METHOD_STAGES; i < METHOD_RATES; ++i) {
    method_add_rates(h, method_row[i - 1], i, old, w->rate, w->state);
#if WITH_PROFILE
    profile_set_time(t0 + method_node[i - 1] * h, m->with->profile);
#endif
#if WITH_INTERNAL
    motion_state_derivative(w->state, w->state + N, m->with, w->rate + i * N_MOVED);
#else
    motion_rate(w->state, m->with, w->rate + i * N_MOVED);
#endif
  }
  (void)t0;
}

#endif
/* Weights of the samples within a step: dense output by terms x + s (D0 + r (D1 + s (D2 + r (D3 + ...)))), see the
 * method; without its own, by the first three, which are cubic Hermite interpolation. Non-zero where there are any. */
static inline int method_adjoin_samples(double t0, real h, const method_adjoint *m)
{
  method_adjoint_work *w = m->work;
  int found = 0, k, j, i;
  for (; *m->n_left > 0 && m->sample_time[*m->n_left - 1] > t0; --*m->n_left) {
    const double time = m->sample_time[*m->n_left - 1];
    const real *weight = m->sample_weight + (*m->n_left - 1) * N_MOVED;
    const real s = (real)((time - t0) / (double)h), r = (real)1.0 - s;
    const real rise = s - s * r + (real)2.0 * s * r * s, first = h * (s * r - s * r * s), last = -h * s * r * s;
    real term = s * r * s;
    /* The weights of x, of the change of x and of the first and last rate in cubic Hermite interpolation. */
    for (k = 0; k < N_MOVED; ++k) {
      w->base[k] += weight[k];
      w->rise[k] += rise * weight[k];
      w->weight[k] += first * weight[k];
      w->weight[METHOD_STAGES * N_MOVED + k] += last * weight[k];
    }
    /* Those of the rates in the further terms. */
    for (i = 0; i < METHOD_TERMS; ++i) {
      term *= i % 2 == 0 ? r : s;
      for (j = 0; j < METHOD_RATES; ++j) {
        const real factor = h * term * method_term[i][j];
        for (k = 0; k < N_MOVED && factor != (real)0.0; ++k) {
          w->weight[j * N_MOVED + k] += factor * weight[k];
        }
      }
    }
    found = 1;
  }
  return found;
}

/* Back over the i-th rate of a step, which depends on those before it. */
static inline void method_adjoin_stage(
    int i, double t0, real h, const real *old, const real *rate, const method_adjoint *m)
{
  method_adjoint_work *w = m->work;
  int k;
  method_add_rates(h, method_row[i - 1], i, old, rate, w->state);
  for (k = 0; k < N_MOVED; ++k) {
    w->along[k] = (real)0.0;
  }
  method_adjoin_rate(t0 + method_node[i - 1] * (double)h, w->state, w->weight + i * N_MOVED, m, w->along);
  method_add_weights(h, method_row[i - 1], i, w->along, w->weight);
  for (k = 0; k < N_MOVED; ++k) {
    w->base[k] += w->along[k];
  }
}

/* Back over a step of the method. */
static inline void method_adjoin_step(const real *row, const method_adjoint *m)
{
  const double t0 = row[0];
  const real h = (real)row[2], *old = row + 4, *rate = row + 4 + N_MOVED;
  method_adjoint_work *w = m->work;
  int i, k;
  /* x1 = x0 + h sum_i b_i k_i: the weight of x1 goes to x0 and, times h b_i, to the rates k_i. */
  for (k = 0; k < N_MOVED * METHOD_RATES; ++k) {
    w->weight[k] = (real)0.0;
  }
  for (k = 0; k < N_MOVED; ++k) {
    w->rise[k] = m->state_weight[k];
    w->base[k] = m->state_weight[k];
  }
  if (method_adjoin_samples(t0, h, m)) {
#if METHOD_HAS_DENSE
    for (k = 0; k < N_MOVED * METHOD_STAGES; ++k) {
      w->rate[k] = rate[k];
    }
    method_complete_rates(t0, h, old, m);
    rate = w->rate;
    for (i = METHOD_RATES - 1; i > METHOD_STAGES; --i) {
      method_adjoin_stage(i, t0, h, old, rate, m);
    }
#endif
    method_adjoin_stage(METHOD_STAGES, t0, h, old, rate, m);
  }
  method_add_weights(h, method_row[METHOD_STAGES - 1], METHOD_STAGES, w->rise, w->weight);
  for (i = METHOD_STAGES - 1; i > 0; --i) {
    method_adjoin_stage(i, t0, h, old, rate, m);
  }
  method_adjoin_rate(t0, old, w->weight, m, w->base);
  for (k = 0; k < N_MOVED; ++k) {
    m->state_weight[k] = w->base[k];
  }
}

#if WITH_EVENTS
#if WITH_MARGIN_JUMPS
/* Back over the jump of the forces of a cable, the transpose of motion_jump_columns; taut: the state where it pulls. */
static inline void method_adjoin_jump(
    int cable, double turned, double time, const real *taut, const real *before, const method_adjoint *m)
{
  method_adjoint_work *w = m->work;
  double margin_rate = 0.0, share = 0.0;
  int k;
  for (k = 0; k < N_CABLE_MARGINS; ++k) {
    w->margin[k] = (real)0.0;
  }
#if WITH_PROFILE
  profile_set_time(time, m->with->profile);
#endif
  /* With the weight w of the state behind: w += (w . jump) / g' grad g. */
  w->margin[cable] = turned;
  motion_margin_jump(taut, taut + N, w->margin, m->with, w->jump);
  w->margin[cable] = (real)1.0;
  motion_adjoint_margin(taut, taut + N, w->margin, m->with, w->found);
  for (k = 0; k < N_MOVED; ++k) {
    margin_rate += w->found[k] * (k < N ? taut[N + k] : before[k]);
    share += w->jump[k] * m->state_weight[k];
  }
#if WITH_PROFILE
  if (m->with->profile != NULL) {
    for (k = 0; k < m->with->profile->knots->n_values; ++k) {
      const int row = motion_driven_row[m->with->profile->knots->place[k]];
      margin_rate += row >= 0 ? w->found[N_MOVED + row] * profile_rate(time, k, m->with->profile) : 0.0;
    }
  }
#endif
  for (k = 0; k < N_VARIED; ++k) {
    w->found[k] *= share / margin_rate;
  }
  for (k = 0; k < N_MOVED; ++k) {
    m->state_weight[k] += w->found[k];
  }
  method_adjoin_numbers(time, m);
}

#endif
/* Back over the extrapolation that passes an event. */
static inline void method_adjoin_event(const real *row, const method_adjoint *m)
{
  const real *old = row + 4, *rate = row + 4 + N_MOVED;
  method_adjoint_work *w = m->work;
  int k;
  for (; *m->n_left > 0 && m->sample_time[*m->n_left - 1] > row[0]; --*m->n_left) {
    for (k = 0; k < N_MOVED; ++k) {
      m->state_weight[k] += m->sample_weight[(*m->n_left - 1) * N_MOVED + k];
    }
  }
#if WITH_MARGIN_JUMPS
  for (k = 0; k < N_CABLE_MARGINS; ++k) {
    const double turned = row[METHOD_TURNED + k];
    if (turned != 0.0) {
      const int is_taut = turned > 0.0;
      method_adjoin_jump(k, turned, is_taut ? row[1] : row[0], is_taut ? rate + N_MOVED : old, rate, m);
    }
  }
#endif
  (void)rate;
  for (k = 0; k < N_MOVED; ++k) {
    w->rise[k] = row[2] * m->state_weight[k];
  }
  method_adjoin_rate(row[0], old, w->rise, m, m->state_weight);
}

#endif
/* Back over all steps of a tape. */
static inline int method_go_back(const real *tape, long long n_taped, const method_adjoint *m)
{
  long long i;
  int k;
  for (i = n_taped - 1; i >= 0; --i) {
    const real *row = tape + i * METHOD_TAPE;
    for (; *m->n_left > 0 && m->sample_time[*m->n_left - 1] >= row[1]; --*m->n_left) {
      for (k = 0; k < N_MOVED; ++k) {
        m->state_weight[k] += m->sample_weight[(*m->n_left - 1) * N_MOVED + k];
      }
    }
#if WITH_PROFILE
    if (m->with->profile != NULL) {
      profile_enter(row[0], m->with->profile);
    }
#endif
#if WITH_EVENTS
    if (row[3] > TAPED_STEP) {
      method_adjoin_event(row, m);
      continue;
    }
#endif
    method_adjoin_step(row, m);
  }
  return all_finite(m->state_weight, N_MOVED) && all_finite(m->number, N_DIRECTED) ? SCENE_OK
                                                                                   : SCENE_NON_FINITE_RESULT;
}

#endif
#endif
