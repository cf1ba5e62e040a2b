#ifndef EVENTS_H
#define EVENTS_H
#include "finite.h"
#include "interpolate.h"
#if WITH_EVENTS

/* A piece of the motion that begins at `time` and takes `length` [s]: from `start` (coordinates, velocities,
 * accelerations) to its end; quintic Hermite in between. */
typedef struct {
  const double *start, *end_coordinate, *end_velocity, *end_acceleration;
  double time, length;
} event_path;

/* Margins at a fraction of the path; point (2 n): the state there. */
static inline void event_margins_at(
    const event_path *path, double fraction, const motion_arguments *with, const scene_run *run, double *point,
    double *margin)
{
  motion_interpolate(
      fraction, path->length, path->start, path->end_coordinate, path->end_velocity, path->end_acceleration, point);
  event_margins(path->time + fraction * path->length, point, point + N, with, run, margin);
}

/* What the search for an event works with, margin by margin. side: 1 or -1, the sign that each had; noise: how far
 * beyond zero it must be to count; margins at the start, middle and end of a path, and their slopes over the whole path
 * there; start_rate: slope at the start [1/s]; trial_margin, nearby_margin, point: values where the search looks. */
typedef struct {
  double side[N_MARGINS], noise[N_MARGINS], start_margin[N_MARGINS], start_rate[N_MARGINS], end_margin[N_MARGINS];
  double end_slope[N_MARGINS], middle_margin[N_MARGINS], middle_slope[N_MARGINS], trial_margin[N_MARGINS];
  double nearby_margin[N_MARGINS], start_slope[N_MARGINS];
  double point[N_STATES];
  int may_cut_at_turn; /* whether a turn that is too near to tell may cut the step */
  int found_margin;    /* the margin whose event was found */
} event_memory;

/* Set how far beyond zero each margin must be to count: lengths by the rounding of coordinates; the condition, the last
 * margin, by that of its value. This may be a difference of larger numbers: where noise was met (noise_factor above 1),
 * also by that of its change within `usual_step`. */
static inline void event_set_noise(const double *coordinate, double noise_factor, double usual_step, event_memory *m)
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
      4e-15 * noise_factor
      * fmax(fabs(m->start_margin[last]), noise_factor > 1.0 ? usual_step * fabs(m->start_rate[last]) : 0.0);
}

/* Distance of margin k from leaving its side, noise included: positive while it is there. */
static inline double event_side_distance(const event_memory *m, const double *margin, int k)
{
  return m->side[k] * margin[k] + m->noise[k];
}

/* Slopes of all margins over the whole path at a fraction of it, by a difference; margin: their values there, NULL if
 * not known. */
static inline void event_slopes(
    const event_path *path, double fraction, const double *margin, const motion_arguments *with, const scene_run *run,
    event_memory *m, double *slope)
{
  const double nearby = fraction < 0.5 ? fraction + 1e-4 : fraction - 1e-4;
  int k;
  if (margin == NULL) {
    event_margins_at(path, fraction, with, run, m->point, m->nearby_margin);
    margin = m->nearby_margin;
  }
  event_margins_at(path, nearby, with, run, m->point, slope);
  for (k = 0; k < N_MARGINS; ++k) {
    slope[k] = (slope[k] - margin[k]) / (nearby - fraction);
  }
}

/* Fraction in [low, high] at which margin k leaves its side, which it has left at `high`, by the Illinois method: the
 * secant, with the distance of an end that stays twice halved. low_distance, high_distance: distances from leaving. */
static inline double event_find_crossing(
    const event_path *path, int k, double low, double low_distance, double high, double high_distance,
    const motion_arguments *with, const scene_run *run, event_memory *m)
{
  int i, last_moved = 0;
  if (low_distance < 0.0) {
    return low;
  }
  for (i = 0; i < 200 && high - low > 1e-10 * high && high - low > 1e-300; ++i) {
    /* The secant, and each eighth time the middle. */
    double fraction = i % 8 == 7
        ? 0.5 * (low + high)
        : (low * high_distance - high * low_distance) / (high_distance - low_distance), distance;
    if (!(fraction > low && fraction < high)) {
      fraction = 0.5 * (low + high);
    }
    event_margins_at(path, fraction, with, run, m->point, m->trial_margin);
    distance = event_side_distance(m, m->trial_margin, k);
    if (distance < 0.0) {
      high = fraction;
      high_distance = distance;
      low_distance *= last_moved == 1 ? 0.5 : 1.0;
      last_moved = 1;
    } else {
      low = fraction;
      low_distance = distance;
      high_distance *= last_moved == -1 ? 0.5 : 1.0;
      last_moved = -1;
    }
  }
  return high;
}

/* Margin k falls at `low` and rises at `high`, on its side at both. Returns the fraction at which it leaves its side in
 * between; minus the fraction of its turn where that comes too near to tell; 2 where neither is the case. */
static inline double event_find_dip(
    const event_path *path, int k, double low, double low_distance, double low_slope, double high,
    double high_distance, double high_slope, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  const double start = low, start_distance = low_distance;
  int i;
  for (i = 0; i < 40; ++i) {
    const double fraction = 0.5 * (low + high);
    /* Where the tangents of both ends meet: a bound of the least distance, as long as the margin curves one way. */
    const double tangents_meet = (high_distance - low_distance - high_slope * (high - low)) / (low_slope - high_slope);
    double distance, slope;
    if (low_distance + low_slope * tangents_meet > (i == 0 ? 0.5 * fmin(low_distance, high_distance) : 0.0)) {
      return 2.0;
    }
    /* The turn is known closely, and touches zero. */
    if (high - low < 1e-5) {
      return m->may_cut_at_turn && low > 1e-3 && high < 0.999 ? -fraction : 2.0;
    }
    event_margins_at(path, fraction, with, run, m->point, m->trial_margin);
    distance = event_side_distance(m, m->trial_margin, k);
    if (distance < 0.0) {
      return event_find_crossing(path, k, start, start_distance, fraction, distance, with, run, m);
    }
    /* Go on with the half in which the margin turns. */
    event_slopes(path, fraction, NULL, with, run, m, m->trial_margin);
    slope = m->side[k] * m->trial_margin[k];
    if (slope < 0.0) {
      low = fraction;
      low_distance = distance;
      low_slope = slope;
    } else {
      high = fraction;
      high_distance = distance;
      high_slope = slope;
    }
  }
  return 2.0;
}

/* The first event in the part [low, high] of a path with margins and slopes at both ends (low_slope NULL: not known);
 * returns its fraction as event_find_dip does, and sets m->found_margin. */
static inline double event_find_in_part(
    const event_path *path, double low, const double *low_margin, const double *low_slope, double high,
    const double *high_margin, const double *high_slope, const motion_arguments *with, const scene_run *run,
    event_memory *m)
{
  double found = 2.0;
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    const double low_distance = event_side_distance(m, low_margin, k),
                 high_distance = event_side_distance(m, high_margin, k);
    double place = 2.0;
    if (high_distance < 0.0) {
      place = event_find_crossing(path, k, low, low_distance, high, high_distance, with, run, m);
    } else if (low_slope != NULL && m->side[k] * low_slope[k] < 0.0 && m->side[k] * high_slope[k] > 0.0) {
      place = event_find_dip(
          path, k, low, low_distance, m->side[k] * low_slope[k], high, high_distance, m->side[k] * high_slope[k], with,
          run, m);
    }
    if (fabs(place) < fabs(found)) {
      found = place;
      m->found_margin = k;
    }
  }
  return found;
}

/* Whether every margin is so far from zero at both ends that its slopes do not bring it there within the path. Holds
 * for cables and bars, whose margins curve little; of a condition nothing is known. */
static inline int event_is_out_of_reach(const event_memory *m)
{
  int k;
  for (k = 0; k < N_MARGINS; ++k) {
    const double side = m->side[k];
    if (side * m->start_margin[k] < -side * m->start_slope[k] || side * m->start_margin[k] < 0.0 ||
        side * m->end_margin[k] < side * m->end_slope[k] || side * m->end_margin[k] < 0.0) {
      return 0;
    }
  }
  return 1;
}

/* The fraction of the first event on a path, as event_find_dip returns it, with margins and rates at its start known.
 * Fills m->end_margin. With `closely` also slopes at both ends are taken, which show margins that leave their sides and
 * come back; with two parts also those in the middle, unless all margins are far from zero. */
static inline double event_find_first(
    const event_path *path, int parts, int closely, const motion_arguments *with, const scene_run *run, event_memory *m)
{
  double found;
  int k;
  event_margins_at(path, 1.0, with, run, m->point, m->end_margin);
  if (!closely) {
    return event_find_in_part(path, 0.0, m->start_margin, NULL, 1.0, m->end_margin, NULL, with, run, m);
  }
  for (k = 0; k < N_MARGINS; ++k) {
    m->start_slope[k] = path->length * m->start_rate[k];
  }
  event_slopes(path, 1.0, m->end_margin, with, run, m, m->end_slope);
  if (parts == 1 || (run->condition == NULL && event_is_out_of_reach(m))) {
    return event_find_in_part(
        path, 0.0, m->start_margin, m->start_slope, 1.0, m->end_margin, m->end_slope, with, run, m);
  }
  event_margins_at(path, 0.5, with, run, m->point, m->middle_margin);
  event_slopes(path, 0.5, m->middle_margin, with, run, m, m->middle_slope);
  found = event_find_in_part(
      path, 0.0, m->start_margin, m->start_slope, 0.5, m->middle_margin, m->middle_slope, with, run, m);
  if (fabs(found) <= 1.0) {
    return found;
  }
  return event_find_in_part(
      path, 0.5, m->middle_margin, m->middle_slope, 1.0, m->end_margin, m->end_slope, with, run, m);
}

#endif

#endif
