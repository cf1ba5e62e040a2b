#ifndef RADAU_PROFILE_H
#define RADAU_PROFILE_H
#include "radau.h"
#include "radau_restart.h"
#if WITH_PROFILE
#if !WITH_FLOAT

/* Whether the members whose tensions are unknowns keep their laws along the whole profile, and all masses stay: the
 * equations of the members, differentiated, know no change of rest lengths. */
static inline int radau_has_constant_laws(radau_work *run)
{
  motion_profile *profile = run->with->profile;
  const scene_profile *knots = profile->knots;
  long long piece;
  int b, i, k;
  radau_laws(run->with, run->law, run->mass);
  profile->low = 0;
  profile->high = knots->n_pieces;
  for (piece = 0; piece < knots->n_pieces; ++piece) {
    /* A polynomial that is constant at so many points is constant. */
    for (i = 0; i <= knots->degree; ++i) {
      const double share = (double)i / (double)(knots->degree + 1);
      profile_set_time(knots->time[piece] + share * (knots->time[piece + 1] - knots->time[piece]), profile);
      radau_laws(run->with, run->law_later, run->mass_later);
      for (b = 0; b < N_TENSIONS; ++b) {
        const int first = (3 + AXES) * scene_radau_member[b];
        for (k = first; k < first + 3 + AXES; ++k) {
          if (run->law[k] != run->law_later[k]) {
            return 0;
          }
        }
      }
      for (k = 0; k < RADAU_MASSES; ++k) {
        if (run->mass[k] != run->mass_later[k]) {
          return 0;
        }
      }
    }
  }
  return 1;
}

/* Behind a kink of the profile: smooth values anew, and margins, of which some may have changed sides at a jump. */
static inline int radau_pass_kink(
    double time, double step, const double *state,
#if WITH_EVENTS
    long long n_samples, double *sample_tension, const long long *n_sampled, scene_run *events,
#endif
    radau_work *run)
{
  profile_enter(time, run->with->profile);
  profile_set_start(time, run->with->profile);
  if (!radau_restart(run, 0.0, step, state)) {
    return SCENE_NON_FINITE_RESULT;
  }
#if WITH_EVENTS
  if (events->watch) {
    event_memory *m = &run->margins;
    events->time_to_event = 0.0;
    events->step_to_event = 0.0;
    if (!radau_evaluate_margins(run, time, state, events, m)) {
      return SCENE_NON_FINITE_RESULT;
    }
    event_set_noise(state, events->noise_factor, 0.0, m);
    if (event_change_sides(time, m, m->start_margin, events)) {
      event_count(time, step, events);
      if (events->n_rapid_events > MAX_RAPID_EVENTS) {
        return SCENE_TOO_MANY_EVENTS;
      }
      if (events->is_stopped) {
        radau_store_last_tensions(run, n_samples, sample_tension, n_sampled);
      }
    }
  }
#endif
  return SCENE_OK;
}

/* The same as radau_advance, with steps that end at the kinks of the profile. */
static inline int radau_follow(
    double time_end, long long most_steps, double quiet, double *time, double *step, double *state, long long n_samples,
    const double *sample_time, double *sample_state, double *sample_tension, long long *n_sampled, long long *count,
    double *vibration, scene_run *events, radau_work *run)
{
  motion_profile *profile = run->with->profile;
  const int is_first = !(*step > 0.0) || count[0] + count[1] + count[2] == 0;
  const long long before = is_first ? 0 : count[0] + count[1] + count[2];
  int status, is_over;
  long long most = most_steps;
  if (profile != NULL) {
    if (is_first && !radau_has_constant_laws(run)) {
      return SCENE_INVALID_ARGUMENT;
    }
    profile_enter(*time, profile);
  }
  (void)events;
  do {
    const double kink = profile_kink(profile);
    status = radau_advance(
        fmin(time_end, kink), most, quiet, time, step, state, n_samples, sample_time, sample_state, sample_tension,
        n_sampled, count, vibration,
#if WITH_EVENTS
        events,
#endif
        run);
    if (status == SCENE_OK && *time >= kink) {
      status = radau_pass_kink(
          *time, *step, state,
#if WITH_EVENTS
          n_samples, sample_tension, n_sampled, events,
#endif
          run);
    }
    most = most_steps - (count[0] + count[1] + count[2] - before);
#if WITH_EVENTS
    is_over = events != NULL && events->is_stopped;
#else
    is_over = 0;
#endif
  } while (status == SCENE_OK && !is_over && *time < time_end && most > 0);
  return status;
}

#endif
#endif
#endif
