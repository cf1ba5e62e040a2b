#ifndef MPC_ADVANCE_H
#define MPC_ADVANCE_H
#include "memory.h"

/* The state of the model a sample later, with exact derivatives; also for acados. */

/* c += a b with a (rows, inner), b (inner, columns); `*_width`: numbers between two rows. */
static inline void mpc_add_product(int rows, int inner, int columns, const real *a, int a_width, const real *b,
    int b_width, real *c, int c_width)
{
  const int in_fours = inner - inner % 4;
  int i, j, k;
  for (i = 0; i < rows; ++i) {
    const real *left = a + i * a_width;
    real *sum = c + i * c_width;
    for (k = 0; k < in_fours; k += 4) {
      const real *b0 = b + k * b_width, *b1 = b0 + b_width, *b2 = b1 + b_width, *b3 = b2 + b_width;
      const real a0 = left[k], a1 = left[k + 1], a2 = left[k + 2], a3 = left[k + 3];
      for (j = 0; j < columns; ++j) {
        sum[j] += (a0 * b0[j] + a1 * b1[j]) + (a2 * b2[j] + a3 * b3[j]);
      }
    }
    for (k = in_fours; k < inner; ++k) {
      const real *b0 = b + k * b_width, a0 = left[k];
      for (j = 0; j < columns; ++j) {
        sum[j] += a0 * b0[j];
      }
    }
  }
}

/* Rate (N_X,) of a state, and derivatives (N_X, N_C) of the rate, for those of the state by the state and inputs at the
 * start of the sample; is_start: these are the unit matrix. Returns whether all is finite. */
static inline int mpc_rate(const real *state, const real *input, const real *push, int is_start, const real *change,
    real *rate, real *change_rate, scene_control_mpc *m)
{
  int i, j;
  if (control_acceleration(state, state + N_Q, input, rate + N_Q) != 0 ||
      mpc_derivatives(state, state + N_Q, input, m->entry, m->input_entry) != 0) {
    return 0;
  }
  for (i = 0; i < (int)(sizeof STATE_PLACE / sizeof STATE_PLACE[0]); ++i) {
    if (STATE_PLACE[i] >= 0) {
      m->by_state[STATE_PLACE[i]] = m->entry[i];
    }
  }
  for (i = 0; i < (int)(sizeof INPUT_PLACE / sizeof INPUT_PLACE[0]); ++i) {
    if (INPUT_PLACE[i] >= 0) {
      m->by_input[INPUT_PLACE[i]] = m->input_entry[i];
    }
  }
  for (i = 0; i < N_Q; ++i) {
    const real *velocity = change + (N_Q + i) * N_C;
    real *moves = change_rate + i * N_C, *turns = change_rate + (N_Q + i) * N_C;
    rate[i] = state[N_Q + i];
    rate[N_Q + i] += push[i];
    for (j = 0; j < N_C; ++j) {
      moves[j] = velocity[j];
      turns[j] = (real)0.0;
    }
    for (j = 0; j < N_U; ++j) {
      turns[N_X + j] = m->by_input[i * N_U + j];
    }
    for (j = 0; is_start && j < N_X; ++j) {
      turns[j] = m->by_state[i * N_X + j];
    }
  }
  if (!is_start) {
    mpc_add_product(N_Q, N_X, N_C, m->by_state, N_X, change, N_C, change_rate + N_Q * N_C, N_C);
  }
  return 1;
}

/* Move a state over a sample by Runge-Kutta steps of order four, with derivatives m->change (N_X, N_C) by the state and
 * the inputs at its start; push: accelerations of the disturbance forces. Returns whether all is finite. */
static inline int mpc_advance(const real *input, const real *push, real *state, scene_control_mpc *m)
{
  static const real SHARE[4] = {(real)0.0, (real)0.5, (real)0.5, (real)1.0};
  const real step = CONTROL_SAMPLE / (real)MPC_SUBSTEPS;
  int i, k, s;
  memset(m->by_state, 0, sizeof m->by_state);
  memset(m->by_input, 0, sizeof m->by_input);
  memset(m->change, 0, sizeof m->change);
  for (i = 0; i < N_X; ++i) {
    m->change[i * N_C + i] = (real)1.0;
  }
  for (s = 0; s < MPC_SUBSTEPS; ++s) {
    for (k = 0; k < 4; ++k) {
      const real *before = m->rate + (k - 1) * N_X, *change_before = m->change_rate + (k - 1) * N_X * N_C;
      const real span = SHARE[k] * step;
      for (i = 0; i < N_X; ++i) {
        m->stage[i] = k == 0 ? state[i] : state[i] + span * before[i];
      }
      for (i = 0; k > 0 && i < N_X * N_C; ++i) {
        m->stage_change[i] = m->change[i] + span * change_before[i];
      }
      if (!mpc_rate(m->stage, input, push, s == 0 && k == 0, k == 0 ? m->change : m->stage_change,
              m->rate + k * N_X, m->change_rate + k * N_X * N_C, m)) {
        return 0;
      }
    }
    for (i = 0; i < N_X; ++i) {
      const real *r = m->rate + i;
      state[i] += step / (real)6.0 * ((r[0] + r[3 * N_X]) + (real)2.0 * (r[N_X] + r[2 * N_X]));
    }
    for (i = 0; i < N_X * N_C; ++i) {
      const real *r = m->change_rate + i;
      m->change[i] +=
          step / (real)6.0 * ((r[0] + r[3 * N_X * N_C]) + (real)2.0 * (r[N_X * N_C] + r[2 * N_X * N_C]));
    }
  }
  return 1;
}

#endif
