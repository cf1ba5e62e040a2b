#ifndef MPC_STEP_H
#define MPC_STEP_H
#include "mpc_program.h"

/* One step of model-predictive control: the plan of the last step moves on by a sample, and is improved once by the
 * program about it (real-time iteration). */

/* Forget the plan: begin again from the motion. */
static inline void mpc_restart(scene_control_mpc *m)
{
  memset(m->move, 0, sizeof m->move);
  memset(m->sense, 0, sizeof m->sense);
  m->is_planned = m->is_unfinished = 0;
}

/* Move the plan on by a sample. */
static inline void mpc_shift_plan(scene_control_mpc *m)
{
  int b, i;
  for (i = 0; i < N_STAGES * N_X; ++i) {
    m->state[i] = m->state[i + N_X];
  }
  for (b = 0; b < N_BLOCKS; ++b) {
    const int from = mpc_block(BLOCK_START[b] + 1);
    for (i = 0; i < N_U; ++i) {
      m->move[b * N_U + i] = m->move[from * N_U + i];
    }
  }
}

/* Plan about which a step at a time begins. */
static inline void mpc_begin(real time, scene_control *c)
{
  scene_control_mpc *m = &c->mpc;
  real behind = (time - m->plan_time) / CONTROL_SAMPLE - (real)0.5;
  int i;
  if (m->is_planned && !(behind > (real)-1.5 && behind <= (real)N_HORIZON)) {
    mpc_restart(m);
  }
  for (; m->is_planned && behind > (real)0.0; behind -= (real)1.0) {
    mpc_shift_plan(m);
  }
  mpc_set_horizon(time, c);
  if (!m->is_planned) {
    memcpy(m->state, m->goal, sizeof m->state);
  }
  for (i = 0; i < N_X; ++i) {
    m->state[i] = c->estimate[i];
  }
}

/* Change the plan by the solution of the program. */
static inline void mpc_improve(scene_control_mpc *m)
{
  real before[N_X], after[N_X];
  int i, j, k, u;
  memset(before, 0, sizeof before);
  for (k = 0; k < N_STAGES; ++k) {
    const real *transition = m->transition + k * N_X * N_X, *effect = m->effect + k * N_X * N_U;
    for (i = 0; i < N_X; ++i) {
      after[i] = m->gap[k * N_X + i];
      for (j = 0; j < N_X; ++j) {
        after[i] += transition[i * N_X + j] * before[j];
      }
      for (u = 0; u < N_U; ++u) {
        const real share = mpc_old_share(u);
        const int number = k - DELAY_SAMPLES[u];
        const real now = number >= 0 ? m->x[mpc_block(number) * N_U + u] : (real)0.0;
        const real old = number >= 1 ? m->x[mpc_block(number - 1) * N_U + u] : (real)0.0;
        after[i] += effect[i * N_U + u] * (now + share * (old - now));
      }
    }
    for (i = 0; i < N_X; ++i) {
      before[i] = after[i];
      m->state[(k + 1) * N_X + i] += after[i];
    }
  }
  for (i = 0; i < N_V; ++i) {
    m->move[i] += m->x[i];
  }
}

/* Status of a command that was found. */
static inline int mpc_find_status(const scene_control *c)
{
  const scene_control_mpc *m = &c->mpc;
  int k, u, status = SCENE_CONTROL_OK;
  if (m->soft_excess > (real)1e5 * MPC_TOLERANCE) {
    return SCENE_CONTROL_LEAST_TENSION;
  }
  for (k = N_V + (N_BLOCKS - 1) * N_U; k < N_CONSTRAINTS; ++k) {
    status = m->sense[k] & DAQP_ACTIVE ? SCENE_CONTROL_TENSION_LIMITED : status;
  }
  for (u = 0; u < N_U; ++u) {
    if (m->sense[u] & DAQP_ACTIVE) {
      const real command = c->command[u];
      const int is_ranged = command <= ACTUATOR_LEAST[u] + MPC_TOLERANCE || command >= ACTUATOR_MOST[u] - MPC_TOLERANCE;
      if (!is_ranged) {
        return SCENE_CONTROL_RATE_LIMITED;
      }
      status = SCENE_CONTROL_RANGE_LIMITED;
    }
  }
  return status;
}

/* Whether the planned states are within reach of the motion at once and after the horizon. */
static inline int mpc_is_within_reach(const scene_control_mpc *m)
{
  const real span = CONTROL_SAMPLE * (real)N_STAGES;
  int i, k;
  for (k = 0; k <= N_STAGES; ++k) {
    const real *state = m->state + k * N_X, *goal = m->goal + k * N_X;
    for (i = 0; i < N_Q; ++i) {
      const real off = state[i] - goal[i], drift = (state[N_Q + i] - goal[N_Q + i]) * span, most = PLAN_REACH[i];
      if (off > most || off < -most || drift > most || drift < -most) {
        return 0;
      }
    }
  }
  return 1;
}

/* Command of a step from the estimate, within work.low and work.high; returns the status. Where the program needs more
 * iterations, the command is that of the plan before, and the next step goes on with that plan, once. After any other
 * failure, or where the structure cannot do what is planned, the next plan begins again from the motion: about such a
 * plan no step may succeed. */
static inline int control_predict(real time, scene_control *c)
{
  scene_control_mpc *m = &c->mpc;
  int is_found, status = SCENE_CONTROL_NOT_SOLVED, u;
  mpc_begin(time, c);
  m->iterations = 0;
  is_found = mpc_linearise(c) && mpc_condense(c->deviation + N_X, c) && mpc_solve(m);
  if (is_found) {
    mpc_improve(m);
    is_found = control_all_finite(m->state, (N_STAGES + 1) * N_X) && control_all_finite(m->move, N_V);
  }
  if (!is_found && (m->iterations <= QP_ITERATIONS || m->is_unfinished)) {
    mpc_restart(m);
  } else {
    m->is_unfinished = !is_found;
  }
  for (u = 0; u < N_U; ++u) {
    c->wanted[u] = m->planned[u] + m->move[u];
  }
  actuators_clip_command(c);
  if (is_found) {
    status = mpc_find_status(c);
    m->is_planned = 1;
    if (!mpc_is_within_reach(m)) {
      mpc_restart(m);
    }
  }
  m->plan_time = time;
  return status;
}

#endif
