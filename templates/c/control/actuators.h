#ifndef CONTROL_ACTUATORS_H
#define CONTROL_ACTUATORS_H
#include "memory.h"
#include "motion.h"

/* Whether all numbers are finite. */
static inline int control_all_finite(const real *values, int count)
{
  int k;
  for (k = 0; k < count; ++k) {
    if (!(values[k] - values[k] == (real)0.0)) {
      return 0;
    }
  }
  return 1;
}

/* Bounds (work.low, work.high) of a command within rates and ranges, so long after the last one. */
static inline void actuators_find_bounds(real span, scene_control *c)
{
  int u;
  for (u = 0; u < N_U; ++u) {
    const real low = c->command[u] - ACTUATOR_RATE[u] * span, high = c->command[u] + ACTUATOR_RATE[u] * span;
    c->work.high[u] = high < ACTUATOR_MOST[u] ? high : ACTUATOR_MOST[u];
    c->work.low[u] = low > ACTUATOR_LEAST[u] ? low : ACTUATOR_LEAST[u];
    c->work.low[u] = c->work.low[u] < c->work.high[u] ? c->work.low[u] : c->work.high[u];
  }
}

#if !WITH_DISTRIBUTION
/* Value between two bounds. */
static inline real control_clip(real value, real low, real high)
{
  const real least = value > low ? value : low;
  return least < high ? least : high;
}

/* Whether two inputs differ by more than rounding. */
static inline int control_differs(real a, real b)
{
  return a - b > SAME_COMMAND || b - a > SAME_COMMAND;
}

/* Command nearest to what is wanted, within work.low and work.high; returns the status. */
static inline int actuators_clip_command(scene_control *c)
{
  int u, status = SCENE_CONTROL_OK;
  for (u = 0; u < N_U; ++u) {
    const real wanted = c->wanted[u];
    c->command[u] = control_clip(wanted, c->work.low[u], c->work.high[u]);
    if (control_differs(c->command[u], wanted) && status == SCENE_CONTROL_OK) {
      status = SCENE_CONTROL_RATE_LIMITED;
    }
  }
  for (u = 0; u < N_U && status != SCENE_CONTROL_OK; ++u) {
    if (control_differs(control_clip(c->wanted[u], ACTUATOR_LEAST[u], ACTUATOR_MOST[u]), c->wanted[u])) {
      status = SCENE_CONTROL_RANGE_LIMITED;
    }
  }
  return status;
}
#endif

/* Set the inputs of the actuators to the commands that have arrived, so long after the last one was sent. */
static inline void actuators_apply_arrived(real since, scene_control *c)
{
  int u;
  for (u = 0; u < N_U; ++u) {
    int row = c->newest - DELAY_SAMPLES[u] - (DELAY_REST[u] > since);
    row += row < 0 ? N_SENT : 0;
    c->input[ACTUATOR_PLACE[u]] = c->sent[row * N_U + u];
  }
}

#if WITH_PAST
/* Take the command among those on their way, which the gains know. */
static inline void actuators_store_past(scene_control *c)
{
  real *past = c->deviation + N_X + N_Z;
  int u, k;
  for (u = 0; u < N_U; ++u) {
    for (k = PAST_START[u + 1] - 1; k > PAST_START[u]; --k) {
      past[k] = past[k - 1];
    }
    if (PAST_START[u] < PAST_START[u + 1]) {
      past[PAST_START[u]] = c->command[u] - c->work.planned[u];
    }
  }
}
#endif

/* Send the command to the actuators; c->input: inputs of the motion, of which those of the actuators are replaced. */
static inline void actuators_send(scene_control *c)
{
  int u;
#if WITH_PAST
  actuators_store_past(c);
#endif
  c->newest = c->newest + 1 < N_SENT ? c->newest + 1 : 0;
  for (u = 0; u < N_U; ++u) {
    c->sent[c->newest * N_U + u] = c->command[u];
  }
  actuators_apply_arrived((real)0.0, c);
}

/* Rest length of the first member of each actuator [m] with these inputs. */
static inline void actuators_sum_rest_lengths(const real *input, real *rest_length)
{
  int u, k;
  for (u = 0; u < N_U; ++u) {
    rest_length[u] = REST_LENGTH[u];
    for (k = REST_START[u]; k < REST_START[u + 1]; ++k) {
      rest_length[u] += input[REST_INPUT[k]];
    }
  }
}

/* Rest lengths that the command gives. */
static inline void actuators_rest_length(const scene_control *c, real *rest_length)
{
  real input[N_IN];
  int k;
  for (k = 0; k < N_IN; ++k) {
    input[k] = c->input[k];
  }
  for (k = 0; k < N_U; ++k) {
    input[ACTUATOR_PLACE[k]] = c->command[k];
  }
  actuators_sum_rest_lengths(input, rest_length);
}

/* Rest lengths at the start of the motion. */
static inline void actuators_start_length(real *rest_length)
{
  real input[N_IN];
  motion_input((real)0.0, input);
  actuators_sum_rest_lengths(input, rest_length);
}

#endif
