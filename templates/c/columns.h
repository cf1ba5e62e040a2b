#ifndef COLUMNS_H
#define COLUMNS_H
#include "config.h"
#if WITH_COLUMNS

/* Rates of the derivatives of a motion, which stand behind its own N_MOVED states, row by row with N_COLUMNS numbers
 * each: S' = J S + df/dp, with the Jacobians of the derivative of the state, sparse by columns. Derivatives to a
 * parameter are times its value in the scene. */
static inline void motion_add_columns(const real *state, const motion_arguments *with, real *rate)
{
  real jacobian[N_STATE_JACOBIAN];
  const real *column = state + N_MOVED;
  real *slope = rate + N_MOVED;
  int i, j, k;
  for (k = 0; k < N_MOVED * N_COLUMNS; ++k) {
    slope[k] = (real)0.0;
  }
  motion_state_jacobian(state, state + N, with, jacobian);
  for (j = 0; j < N_MOVED; ++j) {
    for (i = scene_state_jacobian_column_start[j]; i < scene_state_jacobian_column_start[j + 1]; ++i) {
      const real *TENSEGRITY_RESTRICT x = column + j * N_COLUMNS;
      real *TENSEGRITY_RESTRICT y = slope + scene_state_jacobian_row[i] * N_COLUMNS;
      const real entry = jacobian[i];
      for (k = 0; k < N_COLUMNS; ++k) {
        y[k] += entry * x[k];
      }
    }
  }
#if WITH_PARAMETER_COLUMNS
  {
    real by_parameter[N_PARAMETER_JACOBIAN];
    motion_parameter_jacobian(state, state + N, with, by_parameter);
    for (j = 0; j < N_PARAMETERS; ++j) {
      k = motion_parameter_column[j];
      for (i = scene_parameter_jacobian_column_start[j]; i < scene_parameter_jacobian_column_start[j + 1] && k >= 0; ++i) {
        slope[scene_parameter_jacobian_row[i] * N_COLUMNS + k] += motion_parameter_scale[j] * by_parameter[i];
      }
    }
  }
#endif
}

#if WITH_COLUMN_JUMPS
/* Where forces jump as the margin of a cable changes its sign, on to the derivatives behind that: those of the time of
 * the event, -dg / g', times what the slopes of velocities and internal states, `before` and `after`, jump by. */
static inline void motion_jump_columns(
    int cable, const real *before, const real *after, const motion_arguments *with, real *state)
{
  real by_state[N_MARGIN_STATE_JACOBIAN], moved[N_COLUMNS], pace = (real)0.0;
  real *column = state + N_MOVED;
  int i, j, k;
  for (k = 0; k < N_COLUMNS; ++k) {
    moved[k] = (real)0.0;
  }
  motion_margin_state_jacobian(state, state + N, with, by_state);
  for (j = 0; j < N_MOVED; ++j) {
    for (i = scene_margin_state_jacobian_column_start[j]; i < scene_margin_state_jacobian_column_start[j + 1]; ++i) {
      if (scene_margin_state_jacobian_row[i] == cable) {
        pace += by_state[i] * (j < N ? state[N + j] : before[j - N]);
        for (k = 0; k < N_COLUMNS; ++k) {
          moved[k] += by_state[i] * column[j * N_COLUMNS + k];
        }
      }
    }
  }
#if WITH_MARGIN_PARAMETERS
  {
    real by_parameter[N_MARGIN_PARAMETER_JACOBIAN];
    motion_margin_parameter_jacobian(state, state + N, with, by_parameter);
    for (j = 0; j < N_PARAMETERS; ++j) {
      k = motion_parameter_column[j];
      for (i = scene_margin_parameter_jacobian_column_start[j];
           i < scene_margin_parameter_jacobian_column_start[j + 1] && k >= 0; ++i) {
        if (scene_margin_parameter_jacobian_row[i] == cable) {
          moved[k] += motion_parameter_scale[j] * by_parameter[i];
        }
      }
    }
  }
#endif
  for (i = N; i < N_MOVED; ++i) {
    for (k = 0; k < N_COLUMNS; ++k) {
      column[i * N_COLUMNS + k] += (after[i - N] - before[i - N]) * moved[k] / pace;
    }
  }
}
#endif

#endif
#endif
