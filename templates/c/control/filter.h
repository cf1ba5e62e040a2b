#ifndef CONTROL_FILTER_H
#define CONTROL_FILTER_H
#include "actuators.h"
#include "mass.h"
#include "memory.h"
#include "motion.h"

#if WITH_ESTIMATOR
/* Velocities and accelerations at a state with constant inputs and disturbances; returns whether they are finite. */
static inline int filter_rate(const real *state, const real *input, const real *push, real *rate)
{
  int i;
  if (control_acceleration(state, state + N_Q, input, rate + N_Q) != 0) {
    return 0;
  }
  for (i = 0; i < N_Q; ++i) {
    rate[i] = state[N_Q + i];
    rate[N_Q + i] += push[i];
  }
  return 1;
}

/* Accelerations (work.push) that the disturbance forces cause at a state; returns whether they are finite. */
static inline int filter_accelerate_by_disturbance(const real *state, scene_control *c)
{
  int i;
  for (i = 0; i < N_Q; ++i) {
    c->work.push[i] = c->disturbance[i];
  }
#if WITH_DISTURBANCE
  if (control_mass(state, c->input, c->work.mass_entry, c->work.mass) != 0) {
    return 0;
  }
  return mass_solve(c->work.mass, c->work.push);
#else
  (void)state;
  return 1;
#endif
}

/* One step of the classical Runge-Kutta method; returns whether it is finite. */
static inline int filter_step(real step, scene_control *c)
{
  real *x = c->work.state, *stage = c->work.stage, *rate = c->work.rate;
  int i, k;
  if (!filter_accelerate_by_disturbance(x, c) || !filter_rate(x, c->input, c->work.push, rate)) {
    return 0;
  }
  for (k = 1; k < 4; ++k) {
    const real part = k < 3 ? (real)0.5 * step : step;
    for (i = 0; i < N_X; ++i) {
      stage[i] = x[i] + part * rate[(k - 1) * N_X + i];
    }
    if (!filter_rate(stage, c->input, c->work.push, rate + k * N_X)) {
      return 0;
    }
  }
  for (i = 0; i < N_X; ++i) {
    const real sum = rate[i] + (real)2.0 * rate[N_X + i] + (real)2.0 * rate[2 * N_X + i] + rate[3 * N_X + i];
    x[i] += step / (real)6.0 * sum;
  }
  return 1;
}

/* Move work.state over a time in which inputs are constant; returns whether it is finite. */
static inline int filter_move(real span, scene_control *c)
{
  const real share = (real)SUBSTEPS * (span / CONTROL_SAMPLE) - (real)1e-9;
  int count = (int)share, k;
  count += (real)count < share;
  count = count < 1 ? 1 : count;
  for (k = 0; k < count; ++k) {
    if (!filter_step(span / (real)count, c)) {
      return 0;
    }
  }
  return 1;
}

/* Predict the estimate over a time since the last command; returns whether it is finite. */
static inline int filter_predict(real span, scene_control *c)
{
  int i, k;
  for (i = 0; i < N_X; ++i) {
    c->work.state[i] = c->estimate[i];
  }
  for (k = 0; k < N_STRETCH && STRETCH_START[k] < span; ++k) {
    real end = span;
    if (k + 1 < N_STRETCH && STRETCH_START[k + 1] < span) {
      end = STRETCH_START[k + 1];
    }
    actuators_apply_arrived(STRETCH_START[k], c);
    if (!filter_move(end - STRETCH_START[k], c)) {
      return 0;
    }
  }
  for (i = 0; i < N_X; ++i) {
    c->estimate[i] = c->work.state[i];
  }
  return control_all_finite(c->estimate, N_X);
}

enum { FILTER_DOUBLINGS = 30 }; /* of the largest distance that is accepted, at most */

/* Set the bound of accepted distances as at the start: up to 200 standard deviations, for the estimate may begin with
 * an error. */
static inline void filter_reset_bound(scene_control *c)
{
  c->innovation = (real)100.0;
  c->n_outliers = 0;
}

/* Whether measurements, so far (N_Y,) from their predictions, can be used: up to six standard deviations, or twice what
 * was accepted lately, which decays; twice as far after each one in a row that was not used. */
static inline int filter_accept(const real *from, const real *to, real s, const real *off, scene_control *c)
{
  real most = (real)0.0, bound = (real)2.0 * c->innovation;
  int j;
  for (j = 0; j < N_Y; ++j) {
    const real size = off[j] * (((real)1.0 - s) * from[j] + s * to[j]);
    most = size > most ? size : -size > most ? -size : most;
  }
  bound = bound > (real)6.0 ? bound : (real)6.0;
  for (j = 0; j < c->n_outliers && j < FILTER_DOUBLINGS; ++j) {
    bound *= (real)2.0;
  }
  if (most > bound) {
    c->n_outliers += c->n_outliers < FILTER_DOUBLINGS;
    return 0;
  }
  c->innovation *= (real)0.7;
  c->innovation = most > c->innovation ? most : c->innovation;
  c->n_outliers = 0;
  return 1;
}

/* Start the estimate again from the motion, without disturbances. */
static inline void filter_restart(real time, scene_control *c)
{
  int i;
  motion_state(time, c->estimate);
  for (i = 0; i < N_D; ++i) {
    c->estimate[N_X + i] = (real)0.0;
  }
  for (i = 0; i < N_Q; ++i) {
    c->disturbance[i] = (real)0.0;
  }
  filter_reset_bound(c);
}

/* Correct the estimate by measurements (N_Y,) of a time; returns OK, OUTLIER or ESTIMATE_LOST. */
static inline int filter_correct(real time, const real *measured, scene_control *c)
{
  real s;
  const int k = control_interval(FILTER_TIME, N_FILTER, time, &s);
  const real *from = FILTER_GAIN + k * N_E * N_Y, *to = from + N_E * N_Y;
  real *off = c->work.expected;
  int i, j;
  if (control_measure(c->estimate, c->estimate + N_Q, c->input, c->work.values, off) != 0) {
    return SCENE_CONTROL_ESTIMATE_LOST;
  }
  for (j = 0; j < N_Y; ++j) {
    off[j] = measured[j] - off[j];
  }
  if (!filter_accept(FILTER_WEIGHT + k * N_Y, FILTER_WEIGHT + (k + 1) * N_Y, s, off, c)) {
    return SCENE_CONTROL_OUTLIER;
  }
  for (i = 0; i < N_E; ++i) {
    real sum = (real)0.0;
    for (j = 0; j < N_Y; ++j) {
      sum += (((real)1.0 - s) * from[i * N_Y + j] + s * to[i * N_Y + j]) * off[j];
    }
    c->estimate[i] += sum;
  }
#if WITH_DISTURBANCE
  for (i = 0; i < N_D; ++i) {
    c->disturbance[DISTURBED[i]] = c->estimate[N_X + i];
  }
#endif
  return control_all_finite(c->estimate, N_E) ? SCENE_CONTROL_OK : SCENE_CONTROL_ESTIMATE_LOST;
}
#endif

#endif
