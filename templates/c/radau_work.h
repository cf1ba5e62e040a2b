#ifndef RADAU_WORK_H
#define RADAU_WORK_H
#include "events.h"
#include "radau_config.h"

/* Numbers kept from step to step: step, error and iterations of the last step; whether it may grow; whether there are
 * quiet factors; largest correction and coordinate; the step last taken whole; whether there are third derivatives; where the
 * last call ended. */
enum {
  RADAU_KEPT_STEP,
  RADAU_KEPT_ERROR,
  RADAU_KEPT_ITERATIONS,
  RADAU_KEPT_MAY_GROW,
  RADAU_KEPT_HAS_QUIET_FACTORS,
  RADAU_KEPT_LARGEST_CORRECTION,
  RADAU_KEPT_LARGEST_COORDINATE,
  RADAU_KEPT_USUAL_STEP,
  RADAU_KEPT_HAS_JERK,
  RADAU_KEPT_TIME
};

/* Memory of one integration, carried from call to call, and what a call is given. Sizes in ..._ROOM are at least 1. */
typedef struct {
  double kept[10]; /* places: RADAU_KEPT_... */
  /* Numbers of the member laws, masses, and entries of the matrices of a step. */
  double law[RADAU_LAW], mass[RADAU_MASSES], mass_diagonal[N_UNKNOWNS];
  double mass_entry[RADAU_ENTRY_ROOM], entry[2 * RADAU_ENTRY_ROOM];
  /* Of each member whose tension is an unknown: its vector, length, and terms of its equation. */
  double offset[AXES * TENSION_ROOM], direction[AXES * TENSION_ROOM], turned[AXES * TENSION_ROOM];
  double rest_length_now[TENSION_ROOM], compliance[TENSION_ROOM], lag[TENSION_ROOM], shift[TENSION_ROOM];
  double mobility[TENSION_ROOM], is_quiet[TENSION_ROOM], gap[TENSION_ROOM], rate[TENSION_ROOM];
  double stage_rate[TENSION_ROOM], tension[TENSION_ROOM], old_smooth[TENSION_ROOM], slope[TENSION_ROOM];
  double bend[TENSION_ROOM], stage_tension[3 * TENSION_ROOM], old_tension[3 * TENSION_ROOM];
  /* Of each coordinate: the state at the end of the last step, and the three stages of the next. */
  double velocity[N], acceleration[N], point[N], applied[N], weight[N];
  double old[3 * N], increment[3 * N], old_increment[3 * N], stage_velocity[3 * N], stage_acceleration[3 * N];
  /* The next state, right sides of the linear equations, and factors of their matrices. */
  double trial[2 * N], residual[3 * N_UNKNOWNS], real_side[N_UNKNOWNS], complex_side[2 * N_UNKNOWNS];
  double diagonal[2 * N_UNKNOWNS], spare[2 * N_UNKNOWNS], complex_factor[2 * RADAU_FACTOR_ROOM];
  double real_factor[RADAU_FACTOR_ROOM], smooth_factor[RADAU_FACTOR_ROOM], quiet_factor[RADAU_FACTOR_ROOM];
  double real_inverse[N_UNKNOWNS], smooth_inverse[N_UNKNOWNS], quiet_inverse[N_UNKNOWNS];
  double complex_inverse[2 * N_UNKNOWNS];
#if WITH_RADAU_DAMPED
  double damped_direction[AXES * N_DAMPED], damped_stiffness[N_DAMPED], damped_lag[N_DAMPED];
#endif
#if WITH_EVENTS
  double jerk[N], end_acceleration[N]; /* third derivatives; accelerations at the end of an extrapolation */
  event_memory margins;
#endif
#if WITH_PROFILE
  double driven[N_DRIVEN], law_later[RADAU_LAW], mass_later[RADAU_MASSES];
#endif
  double rtol, atol, share;
  const motion_arguments *with;
  long long *count;
} radau_work;

#endif
