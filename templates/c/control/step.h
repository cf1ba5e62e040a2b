#ifndef CONTROL_STEP_H
#define CONTROL_STEP_H
#include "actuators.h"
#include "filter.h"
#include "gains.h"
#include "memory.h"
#include "motion.h"
#if WITH_DISTRIBUTION
#include "distribute_step.h"
#endif
#if WITH_MPC
#include "mpc_step.h"
#endif
#if WITH_POLICY
#include "policy.h"
#endif

/* Steps of the controller: checks of time and measurements, estimate, command, status. */

enum { CONTROL_READY = 0x5ca1 }; /* mark of memory that init has filled */
enum { CONTROL_REFUSALS = 3 };     /* rising times in a row that are not after the last one: then the clock is theirs */

#if !WITH_POLICY
/* Set c->input to those of the motion in the middle of the sample that begins at a time, since they are held; with
 * delays work.planned has those in the middle of the time in which the command of the sample acts. */
static inline void control_set_motion_inputs(real time, scene_control *c)
{
  const real middle = time + (real)0.5 * CONTROL_SAMPLE;
#if WITH_DELAY
  real last = (real)-1.0;
  int u;
  for (u = 0; u < N_U; ++u) {
    const real delay = (real)DELAY_SAMPLES[u] * CONTROL_SAMPLE + DELAY_REST[u];
    if (delay < last || delay > last) {
      motion_input(middle + delay, c->input);
      last = delay;
    }
    c->work.planned[u] = c->input[ACTUATOR_PLACE[u]];
  }
#endif
  motion_input(middle, c->input);
}
#endif

/* Begin at the start of the motion; coordinate: where the structure is, NULL: at the start. */
static inline int control_init(scene_control *c, const real *coordinate)
{
  int u, k;
  if (c == NULL) {
    return SCENE_CONTROL_NULL_POINTER;
  }
  memset(c, 0, sizeof *c);
#if !WITH_POLICY
  motion_state((real)0.0, c->estimate);
#endif
  motion_input((real)0.0, c->input);
  for (u = 0; u < N_U; ++u) {
    c->command[u] = c->wanted[u] = c->input[ACTUATOR_PLACE[u]];
    for (k = 0; k < N_SENT; ++k) {
      c->sent[k * N_U + u] = c->command[u];
    }
  }
#if WITH_ESTIMATOR
  filter_reset_bound(c);
#endif
  c->ready = CONTROL_READY;
#if WITH_POLICY
  (void)coordinate;
#else
  if (coordinate != NULL) {
    if (!control_all_finite(coordinate, N_Q)) {
      c->status = SCENE_CONTROL_NON_FINITE_INPUT;
      return c->status;
    }
    for (k = 0; k < N_Q; ++k) {
      c->estimate[k] = coordinate[k];
    }
  }
#endif
  return SCENE_CONTROL_OK;
}

/* Status of a time that is not after the last one. One wrong time far ahead must not stop the controller for good:
 * where several such times in a row rise from each one to the next, the step is LATE, and time goes on from it. */
static inline int control_refuse_time(real time, scene_control *c)
{
  c->n_refused = c->n_refused > 0 && time > c->refused_time ? c->n_refused + 1 : 1;
  c->refused_time = time;
  return c->n_refused < CONTROL_REFUSALS ? SCENE_CONTROL_REPEATED_TIME : SCENE_CONTROL_LATE;
}

/* Time since the last step, within rounding a whole sample; 0 with a status where the time is of no use. */
static inline int control_find_span(real time, scene_control *c, real *span)
{
  const real h = CONTROL_SAMPLE;
  *span = (real)0.0;
  if (!control_all_finite(&time, 1)) {
    return SCENE_CONTROL_NON_FINITE_INPUT;
  }
  if (c->n_steps == 0) {
    *span = h;
    return SCENE_CONTROL_OK;
  }
  if (!(time > c->time)) {
    *span = (real)2.5 * h;
    return control_refuse_time(time, c);
  }
  *span = time - c->time;
  if (*span > (real)2.5 * h) {
    *span = (real)2.5 * h;
    return SCENE_CONTROL_LATE;
  }
  if (*span - h < SAME_SPAN * h && h - *span < SAME_SPAN * h) {
    *span = h;
  }
  return SCENE_CONTROL_OK;
}

#if !WITH_POLICY
/* Keep the last command for another sample. */
static inline void control_hold_command(real time, scene_control *c)
{
  control_set_motion_inputs(time, c);
  actuators_send(c);
}

/* Command of a sample from the estimate, or from the true state in its place; span: since the last command. */
static inline int control_feed_back(real time, real span, scene_control *c)
{
  int k, status;
  motion_state(time, c->work.goal);
#if WITH_MPC
  for (k = 0; k < N_Q; ++k) {
    c->work.goal[k] += c->mpc.target[k];
  }
#endif
  for (k = 0; k < N_X; ++k) {
    c->deviation[k] = c->estimate[k] - c->work.goal[k];
  }
  control_set_motion_inputs(time, c);
  for (k = 0; k < N_U; ++k) {
#if WITH_DELAY
    c->wanted[k] = c->work.planned[k];
#else
    c->wanted[k] = c->input[ACTUATOR_PLACE[k]];
#endif
  }
#if WITH_GAINS
  gains_subtract(time, c->deviation, c->wanted);
#endif
  if (!control_all_finite(c->wanted, N_U)) {
    actuators_send(c);
    return SCENE_CONTROL_ESTIMATE_LOST;
  }
  actuators_find_bounds(span < CONTROL_SAMPLE ? span : CONTROL_SAMPLE, c);
#if WITH_DISTRIBUTION
  status = control_distribute(time, c);
#endif
#if WITH_MPC
  status = control_predict(time, c);
#endif
#if WITH_CLIP
  status = actuators_clip_command(c);
#endif
#if WITH_SUMS
  if (status == SCENE_CONTROL_OK) {
    gains_sum(c->deviation);
  }
#endif
  actuators_send(c);
  return status;
}
#endif

#if WITH_ESTIMATOR
/* Status of measurements: finite, lengths above 0. */
static inline int control_check_measured(const real *measured)
{
  int k;
  if (!control_all_finite(measured, N_Y)) {
    return SCENE_CONTROL_NON_FINITE_INPUT;
  }
  for (k = 0; k < N_Y; ++k) {
    if (IS_LENGTH[k] && !(measured[k] > (real)0.0)) {
      return SCENE_CONTROL_INVALID_LENGTH;
    }
  }
  return SCENE_CONTROL_OK;
}

/* A step from measurements at a usable time; status: of that time. */
static inline int control_step_measured(
    real time, real span, int status, const real *measured, scene_control *c)
{
  int quality = control_check_measured(measured);
  int is_finite = c->n_steps == 0 || filter_predict(span, c);
  if (quality == SCENE_CONTROL_OK && is_finite) {
    quality = filter_correct(time, measured, c);
    is_finite = quality != SCENE_CONTROL_ESTIMATE_LOST;
  }
  if (!is_finite) {
    filter_restart(time, c);
    status = SCENE_CONTROL_ESTIMATE_LOST;
  } else if (status == SCENE_CONTROL_OK) {
    status = quality;
  }
  if (status != SCENE_CONTROL_OK) {
    control_hold_command(time, c);
    return status;
  }
  return control_feed_back(time, span, c);
}
#endif

#if !WITH_POLICY
/* A step from the state at a usable time; status: of that time. */
static inline int control_step_true(real time, real span, int status, const real *state, scene_control *c)
{
  int k;
  if (!control_all_finite(state, N_X)) {
    status = SCENE_CONTROL_NON_FINITE_INPUT;
  } else {
    for (k = 0; k < N_X; ++k) {
      c->estimate[k] = state[k];
    }
  }
  if (status != SCENE_CONTROL_OK) {
    control_hold_command(time, c);
    return status;
  }
  return control_feed_back(time, span, c);
}
#endif

/* A step at a time since the last one; with measurements or the state, of which the other is NULL. */
static inline int control_step_after(
    real time, real span, int status, const real *measured, const real *state, scene_control *c)
{
  if (status == SCENE_CONTROL_OK || status == SCENE_CONTROL_LATE) {
    (void)measured;
#if WITH_POLICY
    (void)state;
    status = control_step_observed(span, status, measured, c);
#else
#if WITH_ESTIMATOR
    status = measured != NULL ? control_step_measured(time, span, status, measured, c)
                              : control_step_true(time, span, status, state, c);
#else
    status = control_step_true(time, span, status, state, c);
#endif
#endif
    c->time = time;
    c->n_refused = 0;
    c->n_steps += c->n_steps < 0x7fffffffL;
  }
  return status;
}

/* Status before a step: whether memory and pointers can be used. */
static inline int control_check_pointers(const scene_control *c, const real *measured_or_state, const real *rest_length)
{
  if (c == NULL || measured_or_state == NULL || rest_length == NULL) {
    return SCENE_CONTROL_NULL_POINTER;
  }
  return c->ready == CONTROL_READY ? SCENE_CONTROL_OK : SCENE_CONTROL_NOT_INITIALISED;
}

/* Write the command, whatever the status is: the last one where a step was not possible. */
static inline int control_write_command(int status, scene_control *c, real *rest_length)
{
  if (c != NULL && c->ready == CONTROL_READY) {
    c->status = status;
    if (rest_length != NULL) {
      actuators_rest_length(c, rest_length);
    }
  } else if (rest_length != NULL) {
    actuators_start_length(rest_length);
  }
  return status;
}

/* A step at a time; with measurements or the state, of which the other is NULL. */
static inline int control_step_at(
    scene_control *c, real time, const real *measured, const real *state, real *rest_length)
{
  int status = control_check_pointers(c, measured != NULL ? measured : state, rest_length);
  real span;
  if (status == SCENE_CONTROL_OK) {
    status = control_find_span(time, c, &span);
    status = control_step_after(time, span, status, measured, state, c);
  }
  return control_write_command(status, c, rest_length);
}

/* A step one sample after the last one, the first at time 0. */
static inline int control_step_next(scene_control *c, const real *measured, const real *state, real *rest_length)
{
  int status = control_check_pointers(c, measured != NULL ? measured : state, rest_length);
  if (status == SCENE_CONTROL_OK) {
    const real time = (real)c->n_steps * CONTROL_SAMPLE;
    status = control_step_after(time, CONTROL_SAMPLE, status, measured, state, c);
  }
  return control_write_command(status, c, rest_length);
}

#endif
