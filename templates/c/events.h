#ifndef EVENTS_H
#define EVENTS_H
#include "finite.h"
#include "interpolate.h"
#if WITH_EVENTS

/* A piece of the motion: from `old` (q, v, a) to q1, v1, a1 within h; quintic Hermite in between. */
typedef struct {
  const double *old, *q1, *v1, *a1;
  double time, h;
} event_path;

/* Margins at fraction s of the path; point: 2 n. */
static inline void event_margins_at(
    const event_path *path, double s, const motion_arguments *with, const scene_run *run, double *point, double *margin)
{
  motion_interpolate(s, path->h, path->old, path->q1, path->v1, path->a1, point);
  event_margins(path->time + s * path->h, point, point + N, with, run, margin);
}

/* What the search for an event works with, margin by margin: side (1 or -1: where each was), noise; first, middle and
 * last: values at the start, middle and end of the path; rise [1/s] and start: slopes at the start, a second and over
 * the whole path; turn and slope: slopes over the path in the middle and at the end; spare and other: memory. */
typedef struct {
  double side[N_MARGINS], noise[N_MARGINS], first[N_MARGINS], rise[N_MARGINS], last[N_MARGINS], slope[N_MARGINS];
  double middle[N_MARGINS], turn[N_MARGINS], spare[N_MARGINS], other[N_MARGINS], start[N_MARGINS];
  double point[2 * N];
  int may_turn; /* whether a turn that is too near to tell may cut the step */
  int which;    /* the margin whose event was found */
} event_memory;

/* How far beyond zero each margin must be to count: lengths to their rounding, the condition to that of its values,
 * which near zero may be differences of larger ones: where noise shows, to that of what it changes by within
 * `usual_step`. */
static inline void event_noise(const double *coordinate, double noise_factor, double usual_step, event_memory *m)
{
  const int last = N_MARGINS - 1;
  double size = EVENT_SIZE;
  int k;
  for (k = 0; k < N_MEASURED; ++k) {
    size = fmax(size, fabs(coordinate[k]));
  }
  for (k = 0; k < last; ++k) {
    m->noise[k] = 4e-15 * noise_factor * size;
  }
  m->noise[last] =
      4e-15 * noise_factor * fmax(fabs(m->first[last]), noise_factor > 1.0 ? usual_step * fabs(m->rise[last]) : 0.0);
}

/* Distance of margin k from leaving its side, noise included: positive while it is there. */
static inline double event_side_distance(const event_memory *m, const double *margin, int k)
{
  return m->side[k] * margin[k] + m->noise[k];
}

/* Slopes of all margins at s over the whole path; here: margins at s, NULL if not known. */
static inline void event_slopes(
    const event_path *path, double s, const double *here, const motion_arguments *with, const scene_run *run,
    event_memory *m, double *slope)
{
  const double other = s < 0.5 ? s + 1e-4 : s - 1e-4;
  int k;
  if (here == NULL) {
    event_margins_at(path, s, with, run, m->point, m->other);
    here = m->other;
  }
  event_margins_at(path, other, with, run, m->point, slope);
  for (k = 0; k < N_MARGINS; ++k) {
    slope[k] = (slope[k] - here[k]) / (other - s);
  }
}

/* Where in [low, high] margin k leaves its side, that it has left at `high`; f: what is left at both (Illinois). */
static inline double event_root(
    const event_path *path, int k, double low, double f_low, double high, double f_high, const motion_arguments *with,
    const scene_run *run, event_memory *m)
{
  int i, kept = 0;
  if (f_low < 0.0) {
    return low;
  }
  for (i = 0; i < 200 && high - low > 1e-10 * high && high - low > 1e-300; ++i) {
    double s = i % 8 == 7 ? 0.5 * (low + high) : (low * f_high - high * f_low) / (f_high - f_low), f;
    if (!(s > low && s < high)) {
      s = 0.5 * (low + high);
    }
    event_margins_at(path, s, with, run, m->point, m->spare);
    f = event_side_distance(m, m->spare, k);
    if (f < 0.0) {
      high = s;
      f_high = f;
      f_low *= kept == 1 ? 0.5 : 1.0;
      kept = 1;
    } else {
      low = s;
      f_low = f;
      f_high *= kept == -1 ? 0.5 : 1.0;
      kept = -1;
    }
  }
  return high;
}

/* Margin k falls at `low` and rises at `high`, on its side at both. Where it leaves it in between; negative: not so,
 * but the turn at minus this comes too near to tell; 2: neither. */
static inline double event_dip(
    const event_path *path, int k, double low, double f_low, double d_low, double high, double f_high, double d_high,
    const motion_arguments *with, const scene_run *run, event_memory *m)
{
  const double start = low, f_start = f_low;
  int i;
  for (i = 0; i < 40; ++i) {
    const double s = 0.5 * (low + high);
    /* Where the tangents of both ends meet: a bound from below, as long as it curves one way. */
    const double meet = (f_high - f_low - d_high * (high - low)) / (d_low - d_high);
    double f, d;
    if (f_low + d_low * meet > (i == 0 ? 0.5 * fmin(f_low, f_high) : 0.0)) {
      return 2.0;
    }
    if (high - low < 1e-5) {
      return m->may_turn && low > 1e-3 && high < 0.999 ? -s : 2.0;
    }
    event_margins_at(path, s, with, run, m->point, m->spare);
    f = event_side_distance(m, m->spare, k);
    if (f < 0.0) {
      return event_root(path, k, start, f_start, s, f, with, run, m);
    }
    event_slopes(path, s, NULL, with, run, m, m->spare);
    d = m->side[k] * m->spare[k];
    if (d < 0.0) {
      low = s;
      f_low = f;
      d_low = d;
    } else {
      high = s;
      f_high = f;
      d_high = d;
    }
  }
  return 2.0;
}

/* The first event in the part [low, high] of a path with margins and slopes at both ends: where, as event_dip says. */
static inline double event_in_part(
    const event_path *path, double low, const double *first, const double *rise, double high, const double *last,
    const double *slope, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  double found = 2.0;
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    const double f_low = event_side_distance(m, first, k), f_high = event_side_distance(m, last, k);
    double s = 2.0;
    if (f_high < 0.0) {
      s = event_root(path, k, low, f_low, high, f_high, with, run, m);
    } else if (rise != NULL && m->side[k] * rise[k] < 0.0 && m->side[k] * slope[k] > 0.0) {
      s = event_dip(path, k, low, f_low, m->side[k] * rise[k], high, f_high, m->side[k] * slope[k], with, run, m);
    }
    if (fabs(s) < fabs(found)) {
      found = s;
      m->which = k;
    }
  }
  return found;
}

/* Whether every margin is so far from zero at both ends that its slopes do not lead it there within the path; for
 * cables and bars, which turn slowly: of a condition nothing is known. */
static inline int event_is_far(const event_memory *m)
{
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    const double side = m->side[k];
    if (side * m->first[k] < -side * m->start[k] || side * m->first[k] < 0.0 ||
        side * m->last[k] < side * m->slope[k] || side * m->last[k] < 0.0) {
      return 0;
    }
  }
  return 1;
}

/* The first event on a path of which m->first, m->rise are known; fills m->last, and with `closely` m->slope. */
static inline double event_on_path(
    const event_path *path, int parts, int closely, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  double found;
  int k;
  event_margins_at(path, 1.0, with, run, m->point, m->last);
  if (!closely) {
    return event_in_part(path, 0.0, m->first, NULL, 1.0, m->last, NULL, with, run, m);
  }
  for (k = 0; k < N_MARGINS; ++k) {
    m->start[k] = path->h * m->rise[k];
  }
  event_slopes(path, 1.0, m->last, with, run, m, m->slope);
  if (parts == 1 || (run->condition == NULL && event_is_far(m))) {
    return event_in_part(path, 0.0, m->first, m->start, 1.0, m->last, m->slope, with, run, m);
  }
  event_margins_at(path, 0.5, with, run, m->point, m->middle);
  event_slopes(path, 0.5, m->middle, with, run, m, m->turn);
  found = event_in_part(path, 0.0, m->first, m->start, 0.5, m->middle, m->turn, with, run, m);
  if (fabs(found) <= 1.0) {
    return found;
  }
  return event_in_part(path, 0.5, m->middle, m->turn, 1.0, m->last, m->slope, with, run, m);
}

#endif

#endif
