#ifndef EVENT_COURSE_H
#define EVENT_COURSE_H
#include "events.h"
#if WITH_EVENTS

#if WITH_SMOOTH_EVENTS
static const double LONGEST_PASSING = 1e-8; /* of a step: beyond, an extrapolation costs accuracy */
#else
static const double LONGEST_PASSING = 1e-6;
#endif

/* Time in which margin k passes its noise, at most LONGEST_PASSING. */
static inline double event_passing(double usual_step, const event_memory *m, int k)
{
  const double passing = 8.0 * m->noise[k] / fabs(m->rise[k]);
  return passing < LONGEST_PASSING * usual_step ? passing : LONGEST_PASSING * usual_step;
}

/* What counts as at the event that was found: `base`, or the time in which its margin passes its noise. */
static inline double event_near(double base, double usual_step, const event_memory *m)
{
  return base + event_passing(usual_step, m, m->which);
}

/* Note an event of margin k. */
static inline void event_note(double time, int k, int direction, scene_run *run)
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

/* Turn the margins that have left their sides, noting each; returns how many. */
static inline int event_turn(double time, event_memory *m, const double *margin, scene_run *run)
{
  int k, count = 0;
  for (k = 0; k < N_MARGINS; ++k) {
    if (event_side_distance(m, margin, k) < 0.0) {
      m->side[k] = -m->side[k];
      event_note(time, k, m->side[k] > 0.0 ? 1 : -1, run);
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
    const double left = event_side_distance(m, m->last, k);
    if (left < -4.0 * m->noise[k]) {
      return 0;
    }
#if !WITH_SMOOTH_EVENTS
    if (left < 0.0 && k != N_MARGINS - 1 && event_passing(usual_step, m, k) < LONGEST_PASSING * usual_step) {
      return 0;
    }
#endif
    count += left < 0.0;
  }
  return count > 0;
}

/* Begin to watch at a time, with steps of about this length, where the margins are known. */
static inline void event_begin(double time, double step, scene_run *run, event_memory *m)
{
  int k;
  run->ahead = 0.0;
  run->leash = 0.0;
  run->cut = 0.0;
  run->loudness = 1.0;
  run->succession = 0;
  run->crowd = 0;
  run->n_stalled = 0;
  run->mark = time;
  run->last_event = time - step;
  run->pace = step;
  for (k = 0; k < N_MARGINS; ++k) {
    m->side[k] = m->first[k] > 0.0 ? 1.0 : -1.0;
  }
}

/* Zero where events hold the motion up without end. */
static inline int event_goes_on(double time, double step, scene_run *run)
{
  if (fabs(time - run->mark) > 1e-3 * step) {
    run->mark = time;
    run->n_stalled = 0;
  }
  return ++run->n_stalled <= 10 * MOST_IN_SUCCESSION;
}

/* Length of the next step, of `planned`: up to a cut, and short after events in short succession, where the next one
 * is expected near and a long step would miss it. is_short, is_cut: whether it is either. */
static inline double event_step(double planned, const scene_run *run, int *is_short, int *is_cut)
{
  double h = planned;
  *is_short = run->leash > 0.0 && run->leash < h;
  h = *is_short ? run->leash : h;
  *is_cut = run->cut > 0.0 && run->cut < h;
  return *is_cut ? run->cut : h;
}

#if WITH_SMOOTH_EVENTS

/* Whether no margin comes to zero within ten times h, as the motion stands: an event was foretold in error. Events in
 * short succession foretell each other well enough. */
static inline int event_is_off(const event_memory *m, double h, const scene_run *run)
{
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    if (m->side[k] * m->first[k] <= -10.0 * h * m->side[k] * m->rise[k]) {
      return 0;
    }
  }
  return run->leash == 0.0;
}
#endif

/* Whether the event that the motion is at, `root` ahead on an extrapolation of length h, is near enough to be passed.
 * Else the next step is cut at just before it; where the extrapolation meets none, noise was taken for one, or
 * `planned` steps are too long to tell where events are; of overdamped cables shorter ones tell no better. */
static inline int event_is_near(
    double root, double near, double h, double *planned, scene_run *run, const event_memory *m)
{
  run->ahead = 0.0;
  run->cut = 0.0;
#if !WITH_SMOOTH_EVENTS
  (void)planned;
  (void)m;
#endif
  if (root > h) {
    run->loudness *= 8.0;
#if WITH_SMOOTH_EVENTS
    *planned *= event_is_off(m, h, run) ? 0.2 : 1.0;
#endif
    return 0;
  }
  if (root > near) {
    run->cut = root - fmax(root * fmin(0.05, (root / run->pace) * (root / run->pace)), 0.5 * near);
    run->remaining = root - run->cut;
    return 0;
  }
  return 1;
}

/* Try again up to just before the event found at this part of a step of length h, the nearer the less the step went
 * beyond; or up to the turn, where `found` is negative. */
static inline void event_cut(double found, double h, double near, scene_run *run)
{
  const double root = fabs(found) * h;
  run->cut = found < 0.0 ? root : root * (0.999 - 0.05 * (1.0 - found) * (1.0 - found));
#if !WITH_SMOOTH_EVENTS
  run->cut = found < 0.0 || root <= near ? run->cut : fmin(run->cut, root - 0.5 * near);
#endif
  run->remaining = root - run->cut;
  run->ahead = found >= 0.0 && root <= near ? fmax(root, 1e-300) : 0.0;
  ++run->n_rejected;
}

/* After a step that was taken: what is left up to the event that it was cut at. */
static inline void event_taken(double step, int is_cut, int is_landing, scene_run *run)
{
  if (!is_cut) {
    run->leash = 4.0 * run->leash < step ? 4.0 * run->leash : 0.0;
  }
  run->loudness = 1.0;
  run->cut = 0.0;
  run->ahead = is_cut && !is_landing ? run->remaining : 0.0;
}

/* Count an event that follows the last one within a step, or a thousandth of it; after a few, steps are short. */
static inline void event_follows(double time, double step, scene_run *run)
{
  const double gap = time - run->last_event;
  run->succession = gap < 1e-3 * step ? run->succession + 1 : 0;
  run->crowd = gap < step ? run->crowd + 1 : 0;
  run->leash = run->crowd > 5 ? 2.0 * gap + 4e-16 * fabs(time) : 0.0;
  run->last_event = time;
}

#if !WITH_SMOOTH_EVENTS

/* How long ago the margins that have left their sides, at m->last, were zero; no longer than `longest`. */
static inline double event_delay(double longest, const event_memory *m)
{
  double delay = 0.0;
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    delay = event_side_distance(m, m->last, k) < 0.0 ? fmax(delay, fabs(m->last[k] / m->rise[k])) : delay;
  }
  return fmin(delay, longest);
}

/* Forces jump where a margin is zero, not where it is beyond its noise: give velocities what this delay has kept from
 * them. before, after: accelerations on both sides; lost: what rounding took of velocities, NULL if not kept. */
static inline void event_catch_up(
    double delay, const double *before, const double *after, double *velocity, double *lost)
{
  int k;
  for (k = 0; k < N; ++k) {
    const double missing = delay * (after[k] - before[k]) + (lost != NULL ? lost[k] : 0.0), old = velocity[k];
    velocity[k] = old + missing;
    if (lost != NULL) {
      lost[k] = missing - (velocity[k] - old);
    }
  }
}
#endif

/* Margins and their slopes a second at the start of a path; non-zero if they are finite. */
static inline int event_evaluate_margins(
    const event_path *path, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  int k;
  event_margins(path->time, path->old, path->old + N, with, run, m->first);
  event_slopes(path, 0.0, m->first, with, run, m, m->rise);
  for (k = 0; k < N_MARGINS; ++k) {
    m->rise[k] /= path->h;
  }
  return all_finite(m->first, N_MARGINS) && all_finite(m->rise, N_MARGINS);
}

#endif

#endif
