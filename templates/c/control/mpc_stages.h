#ifndef MPC_STAGES_H
#define MPC_STAGES_H
#include "actuators.h"
#include "filter.h"
#include "memory.h"
#include "motion.h"
#include "mpc_advance.h"

/* The samples of the horizon: inputs of the model, and linear models about the plan. */

/* Block of a command; commands after the horizon keep the deviation of the last one. */
static inline int mpc_block(int command)
{
  int b = N_BLOCKS - 1;
  while (b > 0 && command < BLOCK_START[b]) {
    --b;
  }
  return b;
}

/* Command of an actuator in the plan, `number` samples from now; negative: one that is on its way. */
static inline real mpc_command(int number, int u, const scene_control *c)
{
  int row = c->newest + 1 + number;
  if (number >= 0) {
    return c->mpc.planned[number * N_U + u] + c->mpc.move[mpc_block(number) * N_U + u];
  }
  row += row < 0 ? N_SENT : 0;
  return c->sent[row * N_U + u];
}

/* Part of a sample in which the command before the one that arrives in it still acts. */
static inline real mpc_old_share(int u) { return DELAY_REST[u] / CONTROL_SAMPLE; }

/* Set the motion over the horizon that begins at a time, and the inputs of the plan in each sample. Where a command
 * arrives within a sample, the input is the mean of both. */
static inline void mpc_set_horizon(real time, scene_control *c)
{
  scene_control_mpc *m = &c->mpc;
  real input[N_IN];
  int i, k, u;
  for (k = 0; k <= N_STAGES; ++k) {
    motion_state(time + (real)k * CONTROL_SAMPLE, m->goal + k * N_X);
    for (i = 0; i < N_Q; ++i) {
      m->goal[k * N_X + i] += m->target[i];
    }
  }
  for (k = 0; k < N_STAGES; ++k) {
    const real middle = time + ((real)k + (real)0.5) * CONTROL_SAMPLE;
    real last = (real)-1.0;
    motion_input(middle, m->input + k * N_IN);
    for (u = 0; u < N_U; ++u) {
      const real delay = (real)DELAY_SAMPLES[u] * CONTROL_SAMPLE + DELAY_REST[u];
      if (delay < last || delay > last) {
        motion_input(middle + delay, input);
        last = delay;
      }
      m->planned[k * N_U + u] = input[ACTUATOR_PLACE[u]];
    }
  }
  for (k = 0; k < N_STAGES; ++k) {
    for (u = 0; u < N_U; ++u) {
      const real share = mpc_old_share(u);
      const int number = k - DELAY_SAMPLES[u];
      real value = mpc_command(number, u, c);
      if (share > (real)0.0) {
        value += share * (mpc_command(number - 1, u, c) - value);
      }
      m->input[k * N_IN + ACTUATOR_PLACE[u]] = value;
    }
  }
}

/* Set the linear model of each sample about the plan; returns whether all is finite. */
static inline int mpc_linearise(scene_control *c)
{
  scene_control_mpc *m = &c->mpc;
  real push[N_Q], next[N_X];
  int i, j, k;
  memset(push, 0, sizeof push);
#if WITH_PUSH
  if (!filter_accelerate_by_disturbance(m->state, c)) {
    return 0;
  }
  memcpy(push, c->work.push, sizeof push);
#endif
  for (k = 0; k < N_STAGES; ++k) {
    for (i = 0; i < N_X; ++i) {
      next[i] = m->state[k * N_X + i];
    }
    if (!mpc_advance(m->input + k * N_IN, push, next, m)) {
      return 0;
    }
    for (i = 0; i < N_X; ++i) {
      m->gap[k * N_X + i] = next[i] - m->state[(k + 1) * N_X + i];
      for (j = 0; j < N_X; ++j) {
        m->transition[(k * N_X + i) * N_X + j] = m->change[i * N_C + j];
      }
      for (j = 0; j < N_U; ++j) {
        m->effect[(k * N_X + i) * N_U + j] = m->change[i * N_C + N_X + j];
      }
    }
  }
  return control_all_finite(m->gap, N_STAGES * N_X) && control_all_finite(m->transition, N_STAGES * N_X * N_X);
}

#endif
