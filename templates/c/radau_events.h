#ifndef RADAU_EVENTS_H
#define RADAU_EVENTS_H
#include "event_course.h"
#include "radau_restart.h"
#if WITH_EVENTS

/* How far a Taylor series may carry the motion on: with the third derivatives at the end of the last whole step over a
 * thousandth of such a step, which is exact to 1e-12 of its length; without them over a millionth. */
static inline double radau_reach(const radau_work *run, double usual_step)
{
  return run->kept[RADAU_KEPT_HAS_JERK] > 0.0 ? 1e-3 * usual_step : 1e-6 * usual_step;
}

/* The smooth motion a time h later by its Taylor series: fills trial and the path from here to there. */
static inline void radau_extrapolate(radau_work *run, double time, double h, const double *state, event_path *path)
{
  int k;
  for (k = 0; k < N; ++k) {
    const double v = run->velocity[k], a = run->acceleration[k];
    const double jerk = run->kept[RADAU_KEPT_HAS_JERK] > 0.0 ? run->jerk[k] : 0.0;
    run->old[k] = state[k];
    run->old[N + k] = v;
    run->old[2 * N + k] = a;
    run->trial[k] = state[k] + h * (v + 0.5 * h * (a + h * jerk / 3.0));
    run->trial[N + k] = v + h * (a + 0.5 * h * jerk);
    run->end_acceleration[k] = a + h * jerk;
  }
  path->start = run->old;
  path->end_coordinate = run->trial;
  path->end_velocity = run->trial + N;
  path->end_acceleration = run->end_acceleration;
  path->time = time;
  path->length = h;
}

/* Third derivatives at the end of a step of length h, of the cubic through velocities and accelerations at its ends. */
static inline void radau_find_jerk(radau_work *run, double h)
{
  const double *v = run->old + N, *a = run->old + 2 * N;
  int k;
  for (k = 0; k < N; ++k) {
    run->jerk[k] = (6.0 * (v[k] - run->velocity[k]) / h + 2.0 * a[k] + 4.0 * run->acceleration[k]) / h;
  }
  run->kept[RADAU_KEPT_HAS_JERK] = 1.0;
}

/* Margins and their slopes where the motion stands. */
static inline int radau_evaluate_margins(
    radau_work *run, double time, const double *state, const scene_run *events, event_memory *m)
{
  event_path path;
  radau_extrapolate(run, time, events->usual_step, state, &path);
  return event_evaluate_margins(&path, run->with, events, m);
}

/* The first event on a trial step from run->old to run->trial with these velocities and accelerations at its end. */
static inline double radau_event_search(
    radau_work *run, double time, double h, const double *velocity, const double *acceleration, int closely,
    const scene_run *events, event_memory *m)
{
  event_path path;
  path.start = run->old;
  path.end_coordinate = run->trial;
  path.end_velocity = velocity;
  path.end_acceleration = acceleration;
  path.time = time;
  path.length = h;
  return event_find_first(&path, 2, closely, run->with, events, m);
}

/* Samples on an extrapolation that `path` describes, from the tensions at its start. */
static inline void radau_sample_extrapolated(
    const radau_work *run, const event_path *path, double t1, long long n_samples, const double *sample_time,
    double *sample_state, double *sample_tension, long long *n_sampled)
{
  int b;
  for (; *n_sampled < n_samples && sample_time[*n_sampled] <= t1; ++*n_sampled) {
    const double later = fmin(sample_time[*n_sampled] - path->time, path->length);
    motion_interpolate(
        later / path->length, path->length, path->start, path->end_coordinate, path->end_velocity,
        path->end_acceleration, sample_state + *n_sampled * 2 * N);
    for (b = 0; b < N_TENSIONS; ++b) {
      sample_tension[*n_sampled * N_TENSIONS + b] = run->tension[b] + later * run->slope[b];
    }
  }
}

/* Pass the event that lies events->time_to_event from here: extrapolate to just beyond it and go on behind it, or say
 * where the next step is to be cut. Returns 0 where something is not finite. */
static inline int radau_event_pass(
    radau_work *run, double left, double *step, double *time, double *state, long long n_samples,
    const double *sample_time,
    double *sample_state, double *sample_tension, long long *n_sampled, scene_run *events, event_memory *m)
{
  const double base = 1e-12 * events->usual_step + 1e-15 * fabs(*time), reach = radau_reach(run, events->usual_step);
  event_path path;
  double root, h, t1, near;
  int k;
#if !WITH_SMOOTH_EVENTS
  double delay;
#endif
  radau_extrapolate(run, *time, fmin(fmax(4.0 * events->time_to_event, 4.0 * base), left), state, &path);
  root = event_find_first(&path, 1, 0, run->with, events, m) * path.length;
  if (!event_can_be_passed(root, reach, path.length, step, events, m)) {
    return 1;
  }
  near = event_tolerance(base, events->usual_step, m);
  h = fmin(root + near, left);
  t1 = h < left ? *time + h : *time + left;
  radau_extrapolate(run, *time, h, state, &path);
  event_margins(t1, path.end_coordinate, path.end_velocity, run->with, events, m->end_margin);
#if !WITH_SMOOTH_EVENTS
  delay = event_delay(2.0 * near, m);
#endif
  if (!event_change_sides(*time + root, m, m->end_margin, events)) {
    events->noise_factor *= 8.0;
    return 1;
  }
  radau_sample_extrapolated(run, &path, t1, n_samples, sample_time, sample_state, sample_tension, n_sampled);
  for (k = 0; k < N; ++k) {
    state[k] = path.end_coordinate[k];
    state[N + k] += path.end_velocity[k] - run->velocity[k];
  }
  event_count(*time + root, *step, events);
  *time = t1;
  ++run->count[0];
  events->noise_factor = 1.0;
#if WITH_PROFILE
  profile_set_start(t1, run->with->profile);
#endif
#if !WITH_SMOOTH_EVENTS
  if (!radau_restart(run, h, *step, state)) {
    return 0;
  }
  event_correct_velocity(delay, run->end_acceleration, run->acceleration, state + N, NULL);
  h = 0.0;
#endif
  return radau_restart(run, h, *step, state) && radau_evaluate_margins(run, t1, state, events, m);
}

/* After a step of length h to `time` that was taken: what is watched from here on, and an event that it ended at. */
static inline int radau_update_events(
    radau_work *run, double time, double step, double h, int is_whole, int is_cut, int is_landing, const double *state,
    scene_run *events, event_memory *m)
{
  int k;
  if (is_whole) {
    for (k = 0; k < N_MARGINS; ++k) {
      m->start_margin[k] = m->end_margin[k];
      m->start_rate[k] = m->end_slope[k] / h;
    }
    events->usual_step = h;
  }
  event_after_step(step, is_cut, is_landing, events);
  if (is_landing && event_change_sides(time, m, m->end_margin, events)) {
    event_count(time, step, events);
#if WITH_PROFILE
    profile_set_start(time, run->with->profile);
#endif
    return radau_restart(run, 0.0, step, state) && radau_evaluate_margins(run, time, state, events, m);
  }
  return is_whole || radau_evaluate_margins(run, time, state, events, m);
}

/* Where an event ends a call: the tensions there, in place of the next sample. */
static inline void radau_store_last_tensions(
    const radau_work *run, long long n_samples, double *sample_tension, const long long *n_sampled)
{
  int b;
  for (b = 0; b < N_TENSIONS && *n_sampled < n_samples; ++b) {
    sample_tension[*n_sampled * N_TENSIONS + b] = run->tension[b];
  }
}

#endif
#endif
