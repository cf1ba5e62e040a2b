#ifndef CONTROL_FILTER_H
#define CONTROL_FILTER_H
#include "actuators.h"
#include "mass.h"
#include "memory.h"
#include "motion.h"

#if WITH_ESTIMATOR
/* Velocities and accelerations at a state with constant inputs and disturbance accelerations; returns whether they are
 * finite. */
static inline int filter_state_rate(const real *state, const real *input, const real *disturbance, real *rate)
{
  int i;
  if (control_acceleration(state, state + N_Q, input, rate + N_Q) != 0) {
    return 0;
  }
  for (i = 0; i < N_Q; ++i) {
    rate[i] = state[N_Q + i];
    rate[N_Q + i] += disturbance[i];
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

/* One step of the classical Runge-Kutta method of work.state; returns whether it is finite. */
static inline int filter_step(real step, scene_control *c)
{
  real *state = c->work.state, *stage = c->work.stage, *rate = c->work.rate;
  int i, k;
  if (!filter_accelerate_by_disturbance(state, c) || !filter_state_rate(state, c->input, c->work.push, rate)) {
    return 0;
  }
  /* Stages two to four. */
  for (k = 1; k < 4; ++k) {
    const real share = k < 3 ? (real)0.5 * step : step;
    for (i = 0; i < N_X; ++i) {
      stage[i] = state[i] + share * rate[(k - 1) * N_X + i];
    }
    if (!filter_state_rate(stage, c->input, c->work.push, rate + k * N_X)) {
      return 0;
    }
  }
  for (i = 0; i < N_X; ++i) {
    const real sum = rate[i] + (real)2.0 * rate[N_X + i] + (real)2.0 * rate[2 * N_X + i] + rate[3 * N_X + i];
    state[i] += step / (real)6.0 * sum;
  }
  return 1;
}

/* Integrate work.state over a time in which inputs are constant, in equal steps of at most the sample over SUBSTEPS;
 * returns whether it is finite. */
static inline int filter_integrate(real duration, scene_control *c)
{
  const real wanted = (real)SUBSTEPS * (duration / CONTROL_SAMPLE) - (real)1e-9;
  int count = (int)wanted, k;
  count += (real)count < wanted;
  count = count < 1 ? 1 : count;
  for (k = 0; k < count; ++k) {
    if (!filter_step(duration / (real)count, c)) {
      return 0;
    }
  }
  return 1;
}

/* Predict the estimate over a time since the last command; returns whether it is finite. */
static inline int filter_predict(real duration, scene_control *c)
{
  int i, k;
  for (i = 0; i < N_X; ++i) {
    c->work.state[i] = c->estimate[i];
  }
  /* Stretches of time between arrivals of delayed commands. */
  for (k = 0; k < N_STRETCH && STRETCH_START[k] < duration; ++k) {
    real end = duration;
    if (k + 1 < N_STRETCH && STRETCH_START[k + 1] < duration) {
      end = STRETCH_START[k + 1];
    }
    actuators_apply_arrived(STRETCH_START[k], c);
    if (!filter_integrate(end - STRETCH_START[k], c)) {
      return 0;
    }
  }
  for (i = 0; i < N_X; ++i) {
    c->estimate[i] = c->work.state[i];
  }
  return control_all_finite(c->estimate, N_X);
}

enum { FILTER_DOUBLINGS = 30 }; /* of the bound of accepted deviations, at most */

/* Set the bound of accepted deviations as at the start: up to 200 standard deviations, for the estimate may begin with
 * an error. */
static inline void filter_reset_bound(scene_control *c)
{
  c->innovation = (real)100.0;
  c->n_outliers = 0;
}

/* Whether measurements with these deviations (N_Y,) from their predictions are used: up to six standard deviations, or
 * twice what was accepted lately, which decays; twice as many after each one in a row that was not used. weight_before,
 * weight_after: 1 over the standard deviations at the knots about the time; fraction: of the time between them. */
static inline int filter_is_plausible(
    const real *weight_before, const real *weight_after, real fraction, const real *deviation, scene_control *c)
{
  real largest = (real)0.0, bound = (real)2.0 * c->innovation;
  int j;
  /* The largest deviation, in standard deviations. */
  for (j = 0; j < N_Y; ++j) {
    const real size = deviation[j] * (((real)1.0 - fraction) * weight_before[j] + fraction * weight_after[j]);
    largest = size > largest ? size : -size > largest ? -size : largest;
  }
  /* The bound, and whether it is exceeded. */
  bound = bound > (real)6.0 ? bound : (real)6.0;
  for (j = 0; j < c->n_outliers && j < FILTER_DOUBLINGS; ++j) {
    bound *= (real)2.0;
  }
  if (largest > bound) {
    c->n_outliers += c->n_outliers < FILTER_DOUBLINGS;
    return 0;
  }
  /* What was accepted lately. */
  c->innovation *= (real)0.7;
  c->innovation = largest > c->innovation ? largest : c->innovation;
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
  real fraction;
  const int k = control_interval(FILTER_TIME, N_FILTER, time, &fraction);
  const real *gain_before = FILTER_GAIN + k * N_E * N_Y, *gain_after = gain_before + N_E * N_Y;
  real *deviation = c->work.expected;
  int i, j;
  /* Measurements minus their predictions; outliers are not used. */
  if (control_measure(c->estimate, c->estimate + N_Q, c->input, c->work.values, deviation) != 0) {
    return SCENE_CONTROL_ESTIMATE_LOST;
  }
  for (j = 0; j < N_Y; ++j) {
    deviation[j] = measured[j] - deviation[j];
  }
  if (!filter_is_plausible(FILTER_WEIGHT + k * N_Y, FILTER_WEIGHT + (k + 1) * N_Y, fraction, deviation, c)) {
    return SCENE_CONTROL_OUTLIER;
  }
  /* The gain at this time times the deviations. */
  for (i = 0; i < N_E; ++i) {
    real correction = (real)0.0;
    for (j = 0; j < N_Y; ++j) {
      correction +=
          (((real)1.0 - fraction) * gain_before[i * N_Y + j] + fraction * gain_after[i * N_Y + j]) * deviation[j];
    }
    c->estimate[i] += correction;
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
