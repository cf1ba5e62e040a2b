#ifndef COLUMNS_H
#define COLUMNS_H
#include "config.h"
#if WITH_ADJOINT
/* Kinds of rows of a tape: a step, an event that is passed; from 0 on, one at which the force of that cable jumps. */
enum { TAPED_STEP = -2, TAPED_EVENT = -1 };

#endif
#if WITH_COLUMNS
#if WITH_COLUMN_JUMPS

/* Change of the margin of a cable with time: all columns along the motion, whose slopes are `slope` behind the
 * coordinates, and along the rates of what follows a profile. */
static inline real motion_margin_pace(
    int cable, double time, const real *slope, const motion_arguments *with, const real *state)
{
  real along[N_STATES], change[N_CABLE_MARGINS * N_COLUMNS];
  motion_arguments own = *with;
  int j, k;
#if WITH_DIRECTION
  real direction[N_DIRECTED * N_COLUMNS];
  for (j = 0; j < N_DIRECTED * N_COLUMNS; ++j) {
    direction[j] = (real)0.0;
  }
  own.direction = direction;
#if WITH_PROFILE
  if (with->profile != NULL) {
    const scene_profile *knots = with->profile->knots;
    for (j = 0; j < knots->n_values; ++j) {
      const int to = motion_driven_row[knots->place[j]];
      const double rate = profile_rate(time, j, with->profile);
      for (k = 0; k < N_COLUMNS && to >= 0; ++k) {
        direction[to * N_COLUMNS + k] = (real)rate;
      }
    }
  }
#endif
#endif
  for (j = 0; j < N_MOVED; ++j) {
    along[j] = state[j];
    for (k = 0; k < N_COLUMNS; ++k) {
      along[N_MOVED + j * N_COLUMNS + k] = j < N ? state[N + j] : slope[j - N];
    }
  }
  motion_margin_column(along, along + N, &own, change);
  (void)time;
  return change[cable * N_COLUMNS];
}

/* Where forces jump as the margin of a cable changes its sign, on to the derivatives behind that: those of the time of
 * the event, -dg / g', times what the slopes of velocities and internal states, `before` and `after`, jump by. */
static inline void motion_jump_columns(
    int cable, double time, const real *before, const real *after, const motion_arguments *with, real *state)
{
  real change[N_CABLE_MARGINS * N_COLUMNS];
  const real pace = motion_margin_pace(cable, time, before, with, state);
  int i, k;
  motion_margin_column(state, state + N, with, change);
  for (i = N; i < N_MOVED; ++i) {
    for (k = 0; k < N_COLUMNS; ++k) {
      state[N_MOVED + i * N_COLUMNS + k] += (after[i - N] - before[i - N]) * change[cable * N_COLUMNS + k] / pace;
    }
  }
}

#endif
#endif
#endif
