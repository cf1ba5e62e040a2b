#ifndef COLUMNS_H
#define COLUMNS_H
#include "config.h"
#if WITH_ADJOINT
/* Kinds of rows of a tape: a step, an event that is passed. */
enum { TAPED_STEP = -2, TAPED_EVENT = -1 };

#endif
#if WITH_COLUMNS
#if WITH_COLUMN_JUMPS

/* Change of the margin of a cable with time: all columns along the motion, whose slopes are `slope` behind the
 * coordinates, and along the rates of what follows a profile. */
static inline real motion_margin_rate(
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
  /* Columns that are all the rate (v, a, z') of the state: the column of the margin is g' then. */
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

/* Where margins of cables change their signs and forces jump, on to the derivatives behind that. Each cable has a time
 * of its own, which changes by -dg / g', and its part of what the slopes jump by; it pulls on one side of the event.
 * turned (N_CABLE_MARGINS,): 1 pulled taut, -1 gone slack, else 0; old: the state at t0, before, and its slopes. */
static inline void motion_jump_columns(
    const real *turned, double t0, double t1, const real *old, const motion_arguments *with, real *state)
{
  real change[N_CABLE_MARGINS * N_COLUMNS], weight[N_CABLE_MARGINS], jump[N_MOVED];
  int cable, i, k;
  for (k = 0; k < N_CABLE_MARGINS; ++k) {
    weight[k] = (real)0.0;
  }
  for (cable = 0; cable < N_CABLE_MARGINS; ++cable) {
    if (turned[cable] != (real)0.0) {
      const int is_taut = turned[cable] > (real)0.0;
      const real *taut = is_taut ? state : old;
      real margin_rate;
#if WITH_PROFILE
      profile_set_time(is_taut ? t1 : t0, with->profile);
#endif
      margin_rate = motion_margin_rate(cable, is_taut ? t1 : t0, old + N_STATES, with, taut);
      weight[cable] = turned[cable];
      motion_margin_jump(taut, taut + N, weight, with, jump);
      weight[cable] = (real)0.0;
      motion_margin_column(taut, taut + N, with, change);
      /* dx/dp += jump of x' times dg/dp / g' */
      for (i = N; i < N_MOVED; ++i) {
        for (k = 0; k < N_COLUMNS; ++k) {
          state[N_MOVED + i * N_COLUMNS + k] += jump[i] * change[cable * N_COLUMNS + k] / margin_rate;
        }
      }
    }
  }
#if WITH_PROFILE
  profile_set_time(t1, with->profile);
#endif
}

#endif
#endif
#endif
