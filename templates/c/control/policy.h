#ifndef CONTROL_POLICY_H
#define CONTROL_POLICY_H
#include "actuators.h"
#include "memory.h"

#if WITH_POLICY
/* Inputs that the network asks the actuators for (c->wanted) after an observation (N_Y,). */
static inline void policy_act(const real *observation, scene_control *c)
{
  real *values = c->work.layer, *result = c->work.layer + N_WIDTH;
  int i, j, k, w = 0, b = 0;
  for (i = 0; i < POLICY_SIZE[0]; ++i) {
    const int source = POLICY_SOURCE[i];
    const real value = source < 0 ? c->command[-1 - source] : observation[source];
    values[i] = control_clip((value - POLICY_MEAN[i]) / POLICY_SCALE[i], -POLICY_CLIP[0], POLICY_CLIP[0]);
  }
  for (k = 1; k <= N_LAYERS; ++k) {
    for (j = 0; j < POLICY_SIZE[k]; ++j, ++b) {
      real sum = POLICY_BIAS[b];
      for (i = 0; i < POLICY_SIZE[k - 1]; ++i, ++w) {
        sum += POLICY_WEIGHT[w] * values[i];
      }
      result[j] = policy_activate(k == N_LAYERS, sum);
    }
    values = result;
    result = c->work.layer + (k % 2 == 0 ? N_WIDTH : 0);
  }
  for (j = 0; j < N_U; ++j) {
    c->action[j] = control_clip(values[j], (real)-1.0, (real)1.0);
    c->wanted[j] = ACTION_CENTRE[j] + ACTION_HALF_RANGE[j] * c->action[j];
  }
}

/* A step from an observation at a usable time; status: of that time. */
static inline int control_step_observed(real span, int status, const real *observation, scene_control *c)
{
  if (!control_all_finite(observation, N_Y)) {
    status = SCENE_CONTROL_NON_FINITE_INPUT;
  }
  if (status == SCENE_CONTROL_OK) {
    policy_act(observation, c);
    actuators_find_bounds(span < CONTROL_SAMPLE ? span : CONTROL_SAMPLE, c);
    status = actuators_clip_command(c);
  }
  actuators_send(c);
  return status;
}
#endif

#endif
