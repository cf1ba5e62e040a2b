#ifndef EXTRAPOLATE_H
#define EXTRAPOLATE_H
#include "event_course.h"
#if WITH_EVENTS

/* The state a short time later, by its Taylor series of second order: fills trial. */
static inline void motion_extrapolate(
    double h, const double *state, const double *lost, const double *rate, double *change, double *trial)
{
  int k;
  for (k = 0; k < N; ++k) {
    const double a = rate[N + k];
    change[k] = h * (rate[k] + 0.5 * h * a) + lost[k];
    change[N + k] = h * a + lost[N + k];
    trial[k] = state[k] + change[k];
    trial[N + k] = state[N + k] + change[N + k];
  }
#if WITH_INTERNAL
  for (k = 2 * N; k < N_STATES; ++k) {
    change[k] = h * rate[k] + lost[k];
    trial[k] = state[k] + change[k];
  }
#endif
}

/* Margins and their slopes a second where the motion is, over an extrapolation of length h; non-zero if they are
 * finite. */
static inline int motion_evaluate_margins(
    double time, double h, const double *state, const double *lost, const double *rate, double *change,
    double *trial, double *old, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  event_path path;
  int k;
  for (k = 0; k < N_STATES; ++k) {
    old[k] = state[k];
  }
  for (k = 0; k < N_SLOPES; ++k) {
    old[N_STATES + k] = rate[N + k];
  }
  motion_extrapolate(h, state, lost, rate, change, trial);
  path.start = old;
  path.end_coordinate = trial;
  path.end_velocity = trial + N;
  path.end_acceleration = rate + N;
  path.time = time;
  path.length = h;
  return event_evaluate_margins(&path, with, run, m);
}

#endif

#endif
