#ifndef EVENT_COURSE_H
#define EVENT_COURSE_H
#include "events.h"
#if WITH_EVENTS

#if WITH_SMOOTH_EVENTS
static const double MAX_NOISE_TIME = 1e-8; /* of a step: longer extrapolations cost accuracy */
#else
static const double MAX_NOISE_TIME = 1e-6;
#endif

#if WITH_CONTACT_EVENTS
/* Whether margin k is of a contact, at which forces do not jump. */
static inline int event_is_kink(int k) { return k >= FIRST_CONTACT && k < FIRST_CONTACT + N_KINKS; }

#endif
#if WITH_STIFFENING
/* Whether the structure is stiffer while margin k is positive: in contact, and without plastic flow. */
static inline int event_stiffens(int k)
{
  int found = 0;
#if WITH_CONTACT_EVENTS
  found |= k >= FIRST_CONTACT && k < FIRST_CONTACT + N_CONTACTS;
#endif
#if WITH_YIELD_EVENTS
  found |= k >= FIRST_STICK + N_SLIPS - N_YIELDS && k < FIRST_STICK + N_SLIPS;
#endif
  return found;
}

#endif
#if WITH_SET_STATES
/* Note in the state which contacts slip. */
static inline void event_set_slips(const event_memory *m, double *state)
{
  int k;
  for (k = 0; k < N_SLIPS; ++k) {
    state[N_STATES - N_SLIPS + k] = m->side[FIRST_STICK + k] > 0.0 ? 0.0 : 1.0;
  }
}

#endif
#if WITH_SETTLING
/* Let internal states keep up with the others; spare: N_STATES. */
static inline void event_settle(double *state, const motion_arguments *with, double *spare)
{
  int k;
  motion_settled_internal(state, state + N, with, spare);
  for (k = N; k < N_SLOPES; ++k) {
    state[N + k] = spare[k - N];
  }
}

#endif
/* Time in which margin k passes its noise, at most MAX_NOISE_TIME of a step. */
static inline double event_noise_time(double usual_step, const event_memory *m, int k)
{
  const double time = 8.0 * m->noise[k] / fabs(m->start_rate[k]);
  return time < MAX_NOISE_TIME * usual_step ? time : MAX_NOISE_TIME * usual_step;
}

/* Distance in time within which the motion counts as at the event that was found: `base`, and the time in which its
 * margin passes its noise. */
static inline double event_tolerance(double base, double usual_step, const event_memory *m)
{
  return base + event_noise_time(usual_step, m, m->found_margin);
}

#if WITH_MOVED_PLACES
static const double MAX_GAP = 1e-4; /* of the longest member */

/* How long it takes until the margins that a projection has moved across zero, from `before` to m->end_margin, come back
 * there; 0 where it has moved none. Where a force jumps, lengths of bars follow it and move the margin back: in between
 * no state agrees with its own forces. */
static inline double event_gap(const double *before, const event_memory *m)
{
  double gap = 0.0;
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    const double distance = fabs(m->end_margin[k]) + 2.0 * m->noise[k];
    if (m->side[k] < 0.0 && before[k] > 0.0 && m->end_margin[k] < m->noise[k] && distance < MAX_GAP * EVENT_SIZE) {
      gap = fmax(gap, 1.5 * distance / fabs(m->start_rate[k]));
    }
  }
  return gap;
}

#endif
/* Write an event of margin k to the list of the caller, and stop the run where it asks for that. */
static inline void event_record(double time, int k, int direction, scene_run *run)
{
  int kind, which;
  event_name(k, &kind, &which);
  if (run->event != NULL && run->n_events < run->most_events) {
    scene_event *event = run->event + run->n_events;
    event->time = time;
    event->kind = kind;
    event->which = which;
    event->direction = direction;
  }
  ++run->n_events;
  if (run->stop & kind) {
    run->is_stopped = 1;
  }
}

/* Change the sides of the margins that have left theirs, and record each as an event; returns how many. */
static inline int event_change_sides(double time, event_memory *m, const double *margin, scene_run *run)
{
  int k, count = 0;
  for (k = 0; k < N_MARGINS; ++k) {
    if (event_side_distance(m, margin, k) < 0.0) {
      m->side[k] = -m->side[k];
      event_record(time, k, m->side[k] > 0.0 ? 1 : -1, run);
      ++count;
    }
  }
  return count;
}

/* Whether all margins that have left their sides have done so by little more than their noise. Where forces jump this
 * is left to extrapolations, which know them on both sides, but for the condition and margins too slow for that. */
static inline int event_is_reached(double usual_step, const event_memory *m)
{
  int k, count = 0;
#if WITH_SMOOTH_EVENTS
  (void)usual_step;
#endif
  for (k = 0; k < N_MARGINS; ++k) {
    const double distance = event_side_distance(m, m->end_margin, k);
    if (distance < -4.0 * m->noise[k]) {
      return 0;
    }
#if !WITH_SMOOTH_EVENTS
    if (distance < 0.0 && k != N_MARGINS - 1 && event_noise_time(usual_step, m, k) < MAX_NOISE_TIME * usual_step) {
      return 0;
    }
#endif
    count += distance < 0.0;
  }
  return count > 0;
}

/* Begin to watch for events at `time`, with steps of about this length; the margins there are known. */
static inline void event_begin(double time, double step, scene_run *run, event_memory *m)
{
  int k;
  run->time_to_event = 0.0;
  run->step_limit = 0.0;
  run->step_to_event = 0.0;
  run->noise_factor = 1.0;
  run->n_rapid_events = 0;
  run->n_close_events = 0;
  run->n_trials = 0;
  run->progress_time = time;
  run->last_event = time - step;
  run->usual_step = step;
  for (k = 0; k < N_MARGINS; ++k) {
    m->side[k] = m->start_margin[k] > 0.0 ? 1.0 : -1.0;
  }
}

/* Zero where events keep the motion from getting ahead: too many attempts within a thousandth of a step. */
static inline int event_may_continue(double time, double step, scene_run *run)
{
  if (fabs(time - run->progress_time) > 1e-3 * step) {
    run->progress_time = time;
    run->n_trials = 0;
  }
#if WITH_NOISY_MARGINS
  /* Rounding of rigid bars, which grows at impacts, can move a margin by more than its noise in no time; and steps and
   * extrapolations disagree about the margin of a ring, where a strand beside it goes slack. */
  if (run->n_trials % 16 == 15) {
    run->noise_factor *= 8.0;
  }
#endif
  return ++run->n_trials <= 10 * MAX_RAPID_EVENTS;
}

/* Length of the next step, at most `planned`: short after events in short succession, where a long step would miss the
 * next one (is_short), and no longer than up to just before an expected event (is_cut). */
static inline double event_limit_step(double planned, const scene_run *run, int *is_short, int *is_cut)
{
  double step = planned;
  *is_short = run->step_limit > 0.0 && run->step_limit < step;
  step = *is_short ? run->step_limit : step;
  *is_cut = run->step_to_event > 0.0 && run->step_to_event < step;
  return *is_cut ? run->step_to_event : step;
}

#if WITH_EVENT_FORECAST

/* Whether no margin reaches zero within ten times `length` at its present rate, so that the expected event was an
 * error. Not asked of events in short succession, which are expected correctly. */
static inline int event_is_mispredicted(const event_memory *m, double length, const scene_run *run)
{
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    if (event_side_distance(m, m->start_margin, k) <= -10.0 * length * m->side[k] * m->start_rate[k]) {
      return 0;
    }
  }
  return run->step_limit == 0.0;
}
#endif

/* Whether the event that lies `event_wait` ahead, on an extrapolation over `length`, is within `tolerance`, so that
 * the extrapolation can pass it. If not, the next step is cut just before it. Where the extrapolation meets no event,
 * noise was taken for one, or `planned` steps are too long to tell where events are (not so of overdamped cables). */
static inline int event_can_be_passed(
    double event_wait, double tolerance, double length, double *planned, scene_run *run, const event_memory *m)
{
  run->time_to_event = 0.0;
  run->step_to_event = 0.0;
#if !WITH_EVENT_FORECAST
  (void)planned;
  (void)m;
#endif
  /* No event on the extrapolation: count more as noise from now on, and take shorter steps. */
  if (event_wait > length) {
    run->noise_factor *= 8.0;
#if WITH_EVENT_FORECAST
    *planned *= event_is_mispredicted(m, length, run) ? 0.2 : 1.0;
#endif
    return 0;
  }
  /* The event is farther ahead: the next step ends just before it. */
  if (event_wait > tolerance) {
    const double part = event_wait / run->usual_step;
    run->step_to_event = event_wait - fmax(event_wait * fmin(0.05, part * part), 0.5 * tolerance);
    run->time_behind_step = event_wait - run->step_to_event;
    return 0;
  }
  return 1;
}

/* Repeat a step up to just before the event that was found at the fraction `found` of it; the less the step went beyond
 * the event, the closer. Where `found` is negative: up to the turn of a margin at minus this fraction. */
static inline void event_shorten_step(double found, double step, double tolerance, scene_run *run)
{
  const double event_wait = fabs(found) * step;
  run->step_to_event = found < 0.0 ? event_wait : event_wait * (0.999 - 0.05 * (1.0 - found) * (1.0 - found));
#if !WITH_SMOOTH_EVENTS
  if (found >= 0.0 && event_wait > tolerance) {
    run->step_to_event = fmin(run->step_to_event, event_wait - 0.5 * tolerance);
  }
#endif
  run->time_behind_step = event_wait - run->step_to_event;
  run->time_to_event = found >= 0.0 && event_wait <= tolerance ? fmax(event_wait, 1e-300) : 0.0;
  ++run->n_rejected;
}

/* After an accepted step: relax the limit of short steps, and note how far ahead the event is that it was cut at. */
static inline void event_after_step(double step, int is_cut, int is_landing, scene_run *run)
{
  if (!is_cut) {
    run->step_limit = 4.0 * run->step_limit < step ? 4.0 * run->step_limit : 0.0;
  }
  run->noise_factor = 1.0;
  run->step_to_event = 0.0;
  run->time_to_event = is_cut && !is_landing ? run->time_behind_step : 0.0;
}

/* Count events that follow the last one within a thousandth of a step, and those within a step; after more than five of
 * the latter steps are limited to twice the time between them. */
static inline void event_count(double time, double step, scene_run *run)
{
  const double gap = time - run->last_event;
  run->n_rapid_events = gap < 1e-3 * step ? run->n_rapid_events + 1 : 0;
  run->n_close_events = gap < step ? run->n_close_events + 1 : 0;
  run->step_limit = run->n_close_events > 5 ? 2.0 * gap + 4e-16 * fabs(time) : 0.0;
  run->last_event = time;
}

#if !WITH_SMOOTH_EVENTS

/* How long ago the margins that have left their sides, at m->end_margin, were zero; no longer than `longest`. */
static inline double event_delay(double longest, const event_memory *m)
{
  double delay = 0.0;
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
#if WITH_CONTACT_EVENTS
    if (event_is_kink(k)) {
      continue;
    }
#endif
    delay = event_side_distance(m, m->end_margin, k) < 0.0 ? fmax(delay, fabs(m->end_margin[k] / m->start_rate[k]))
                                                           : delay;
  }
  return fmin(delay, longest);
}

/* Forces jump where a margin is zero, not where it is beyond its noise: add to velocities what this delay has kept from
 * them. before, after: accelerations on both sides; rounding: what rounding took of velocities, NULL if not kept. */
static inline void event_correct_velocity(
    double delay, const double *before, const double *after, double *velocity, double *rounding)
{
  int k;
  for (k = 0; k < N; ++k) {
    const double correction = delay * (after[k] - before[k]) + (rounding != NULL ? rounding[k] : 0.0),
                 uncorrected = velocity[k];
    velocity[k] = uncorrected + correction;
    if (rounding != NULL) {
      rounding[k] = correction - (velocity[k] - uncorrected);
    }
  }
}
#endif

/* Margins and their slopes a second at the start of a path; non-zero if they are finite. */
static inline int event_evaluate_margins(
    const event_path *path, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  int k;
  event_margins(path->time, path->start, path->start + N, with, run, m->start_margin);
  event_slopes(path, 0.0, m->start_margin, with, run, m, m->start_rate);
  for (k = 0; k < N_MARGINS; ++k) {
    m->start_rate[k] /= path->length;
  }
  return all_finite(m->start_margin, N_MARGINS) && all_finite(m->start_rate, N_MARGINS);
}

#endif

#endif
