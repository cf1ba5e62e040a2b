#ifndef RADAU_SMOOTH_H
#define RADAU_SMOOTH_H
#include "first_step.h"
#include "interpolate.h"
#include "radau_step.h"
#if !WITH_FLOAT

/* The smooth motion about which members vibrate, in the integrator radau: its start, first step, and values at ends of
 * steps. */

/* Amplitudes of the vibrations of members about the smooth motion at the start: b counts the members whose tensions are
 * unknowns. A member is quiet, so that no step has to resolve it, where its amplitude is below the tolerance or `quiet`
 * [m]. vibration (3,): largest amplitudes [m], [m/s], [N]. Returns the longest step that resolves the others. */
static inline double radau_find_vibration(radau_work *run, const double *state, double quiet, double *vibration)
{
  const double *velocity = state + N;
  double longest = INFINITY, largest = 0.0;
  int b, k;
  for (k = 0; k < N; ++k) {
    largest = fmax(largest, fabs(state[k]));
  }
  vibration[0] = vibration[1] = vibration[2] = 0.0;
  for (b = 0; b < N_TENSIONS; ++b) {
    const double compliance = run->compliance[b],
                 frequency_squared = compliance > 0.0 ? run->mobility[b] / compliance : INFINITY;
    /* How far tension and rate of the length are from those of the smooth motion. */
    const double extension = compliance * (run->tension[b] - run->stage_tension[b]);
    const int *coordinate = radau_coordinate + 2 * AXES * b;
    double extension_rate = 0.0, amplitude;
    for (k = 0; k < AXES; ++k) {
      const int first = coordinate[k], second = coordinate[AXES + k];
      extension_rate += run->direction[AXES * b + k]
          * ((first < 0 ? 0.0 : velocity[first] - run->velocity[first])
              - (second < 0 ? 0.0 : velocity[second] - run->velocity[second]));
    }
    /* Both together are the amplitude. */
    amplitude = sqrt(extension * extension + extension_rate * extension_rate / frequency_squared);
    run->is_quiet[b] = amplitude <= fmax(quiet, run->atol + run->rtol * largest) ? 1.0 : 0.0;
    if (compliance > 0.0) {
      vibration[0] = fmax(vibration[0], amplitude);
      vibration[1] = fmax(vibration[1], amplitude * sqrt(frequency_squared));
      vibration[2] = fmax(vibration[2], amplitude / compliance);
      longest = run->is_quiet[b] > 0.0 ? longest : fmin(longest, 0.5 / sqrt(frequency_squared));
    }
  }
  return longest;
}

/* Set run->slope, how fast tensions change along the motion from (q, run->velocity), by those shortly before and after;
 * left as it is where nothing moves. Returns 0 where there are no tensions. */
static inline int radau_find_slopes(radau_work *run, const double *q)
{
  double *velocity = run->old, *acceleration = run->old + N, *moved_coordinate = run->trial,
         *moved_velocity = run->trial + N;
  double longest_member = 0.0, largest_speed = 0.0, largest_acceleration = 0.0, time_step;
  int k, b, side;
  /* A time in which the structure moves by a small part of its size. */
  for (b = 0; b < N_TENSIONS; ++b) {
    longest_member = fmax(longest_member, run->gap[b] + run->rest_length_now[b]);
  }
  for (k = 0; k < N; ++k) {
    velocity[k] = run->velocity[k];
    acceleration[k] = run->acceleration[k];
    largest_speed = fmax(largest_speed, fabs(velocity[k]) / longest_member);
    largest_acceleration = fmax(largest_acceleration, fabs(acceleration[k]) / longest_member);
  }
  time_step = 1e-4 / fmax(largest_speed, sqrt(largest_acceleration));
  if (!(time_step < 1e100)) {
    return 1;
  }
  /* Tensions of the smooth motion that time later and earlier. */
  for (side = 0; side < 2; ++side) {
    const double shift = side == 0 ? time_step : -time_step;
    for (k = 0; k < N; ++k) {
      moved_coordinate[k] = q[k] + shift * (velocity[k] + 0.5 * shift * acceleration[k]);
      moved_velocity[k] = velocity[k] + shift * acceleration[k];
    }
#if WITH_PROFILE
    profile_set_stage(shift, run->with->profile);
#endif
    if (!radau_smooth(run, INFINITY, moved_coordinate, moved_velocity, run->stage_tension, run->slope, run->bend)) {
      return 0;
    }
    for (b = 0; b < N_TENSIONS && side == 0; ++b) {
      run->old_smooth[b] = run->tension[b];
    }
  }
  /* The central difference. */
  for (b = 0; b < N_TENSIONS; ++b) {
    run->slope[b] = 0.5 * (run->old_smooth[b] - run->tension[b]) / time_step;
  }
#if WITH_PROFILE
  profile_set_stage(0.0, run->with->profile);
#endif
  return 1;
}

/* A first step that resolves the smooth motion, wherever the origin lies: from how strongly its accelerations respond
 * to small displacements, in three trials of which each follows the response of the last one. */
static inline double radau_first_step(radau_work *run, double span, const double *state)
{
  double *rate = run->increment, *moved_rate = run->old, fastest = 0.0;
  int trial, k;
  for (k = 0; k < N; ++k) {
    rate[k] = run->velocity[k];
    rate[N + k] = run->acceleration[k];
  }
  for (trial = 0; trial < 3; ++trial) {
    double response;
    motion_displace(1, trial, state, rate, trial ? moved_rate : rate, run->trial);
    if (!radau_smooth(run, INFINITY, run->trial, run->trial + N, run->stage_tension, run->slope, run->bend)) {
      break;
    }
    for (k = 0; k < N; ++k) {
      moved_rate[k] = run->velocity[k];
      moved_rate[N + k] = run->acceleration[k];
    }
    response = motion_response(1, state, rate, run->trial, moved_rate);
    fastest = fmax(fastest, trial == 2 ? response : sqrt(response));
  }
  return motion_first_step(1, span, run->rtol, run->atol, 4.0, fastest, state, rate);
}

/* Begin at `state`: how members vibrate, a step that is surely short enough, smooth velocities, accelerations and
 * tensions. */
static inline int radau_begin(
    radau_work *run, double span, double quiet, double *step, const double *state, double *vibration)
{
  const double *q = state, *v = state + N;
  double longest;
  int b;
  /* Tensions as the laws of the members state them, the starting values of those of the smooth motion. */
  for (b = 0; b < N_TENSIONS; ++b) {
    run->slope[b] = 0.0;
    run->bend[b] = 0.0;
    run->is_quiet[b] = 0.0;
  }
  radau_members(run, q, v, run->direction, run->gap, run->rate);
  for (b = 0; b < N_TENSIONS; ++b) {
    const double kappa = run->compliance[b];
    run->stage_tension[b] = kappa > 0.0 ? (run->gap[b] + run->lag[b] * run->rate[b]) / kappa : 0.0;
  }
  /* The smooth motion, for which every member counts as rigid: a step without end. */
  if (!radau_smooth(run, INFINITY, q, v, run->stage_tension, run->slope, run->bend) || !radau_find_slopes(run, q)
      || !radau_smooth(run, INFINITY, q, v, run->stage_tension, run->slope, run->bend)) {
    return 0;
  }
  /* A first step that resolves the smooth motion and the vibrations that are not quiet. */
  longest = radau_find_vibration(run, state, quiet, vibration);
  if (!(*step > 0.0)) {
    *step = radau_first_step(run, span, state);
  }
  *step = fmin(*step, longest);
  /* Nothing is known of steps before this one. */
  run->kept[RADAU_KEPT_STEP] = 0.0;
  run->kept[RADAU_KEPT_ERROR] = 1e-2;
  run->kept[RADAU_KEPT_ITERATIONS] = 0.0;
  run->kept[RADAU_KEPT_MAY_GROW] = 1.0;
  run->kept[RADAU_KEPT_USUAL_STEP] = 0.0;
  run->kept[RADAU_KEPT_HAS_JERK] = 0.0;
  return radau_smooth(run, *step, q, v, run->stage_tension, run->slope, run->bend);
}

/* Back to the start of a step that is not taken. */
static inline void radau_revert(radau_work *run, double h, const double *state)
{
  int k, b;
  for (k = 0; k < N; ++k) {
    run->velocity[k] = run->old[N + k];
    run->acceleration[k] = run->old[2 * N + k];
  }
  for (b = 0; b < N_TENSIONS; ++b) {
    run->tension[b] = run->old_smooth[b];
  }
  radau_factor_smooth(run, h, state, run->velocity);
}

/* Smooth values at the end of the step of length h to run->trial, with those at its start in run->old; `usual_step` is
 * how long steps are. Returns 0, with everything as before, where there are none. */
static inline int radau_smooth_end(radau_work *run, double h, double usual_step, const double *state)
{
  int k, b;
  /* What the step begins with. */
  for (k = 0; k < N; ++k) {
    run->old[k] = state[k];
    run->old[N + k] = run->velocity[k];
    run->old[2 * N + k] = run->acceleration[k];
  }
  /* Slopes of tensions at the end, by the parabola through those of the stages. */
  for (b = 0; b < N_TENSIONS; ++b) {
    const double *tension = run->stage_tension + b;
    run->old_smooth[b] = run->tension[b];
    if (h >= 0.5 * usual_step) { /* over less, differences say nothing */
      run->slope[b] = (radau_slope[0] * tension[0] + radau_slope[1] * tension[N_TENSIONS]
          + radau_slope[2] * tension[2 * N_TENSIONS]) / h;
      run->bend[b] = (radau_curvature[0] * tension[0] + radau_curvature[1] * tension[N_TENSIONS]
          + radau_curvature[2] * tension[2 * N_TENSIONS]) / (h * h);
    }
  }
#if WITH_PROFILE
  profile_set_stage(h, run->with->profile);
#endif
  if (!radau_smooth(
          run, fmax(h, usual_step), run->trial, run->trial + N, run->stage_tension + 2 * N_TENSIONS, run->slope,
          run->bend)) {
    radau_revert(run, h, state);
    return 0;
  }
  return 1;
}

/* Accept the step of length h from `time` to run->trial at `end`, and write the samples within it. */
static inline void radau_accept_step(
    radau_work *run, double h, double time, double end, double *state, long long n_samples, const double *sample_time,
    double *sample_state, double *sample_tension, long long *n_sampled)
{
  int k, b, i;
  /* The new state; increments and tensions of the stages are what the next iteration starts from. */
  for (k = 0; k < 2 * N; ++k) {
    state[k] = run->trial[k];
  }
  for (k = 0; k < 3 * N; ++k) {
    run->old_increment[k] = run->increment[k];
  }
  for (k = 0; k < 3 * N_TENSIONS; ++k) {
    run->old_tension[k] = run->stage_tension[k];
  }
  while (*n_sampled < n_samples && sample_time[*n_sampled] <= end) {
    const double fraction = end <= sample_time[*n_sampled] ? 1.0 : (sample_time[*n_sampled] - time) / h;
    motion_interpolate(
        fraction, h, run->old, state, run->velocity, run->acceleration, sample_state + *n_sampled * 2 * N);
    /* Tensions: the parabola through the stages, corrected to the smooth ones at both ends. */
    for (b = 0; b < N_TENSIONS; ++b) {
      double value = 0.0, value_at_start = 0.0;
      for (i = 0; i < 3; ++i) {
        const double node = radau_node[i], next = radau_node[(i + 1) % 3], last = radau_node[(i + 2) % 3];
        value += (fraction - next) * (fraction - last) / ((node - next) * (node - last))
            * run->stage_tension[i * N_TENSIONS + b];
        value_at_start += radau_to_start[i] * run->stage_tension[i * N_TENSIONS + b];
      }
      sample_tension[*n_sampled * N_TENSIONS + b] =
          value + (1.0 - fraction) * (run->old_smooth[b] - value_at_start)
          + fraction * (run->tension[b] - run->stage_tension[2 * N_TENSIONS + b]);
    }
    ++*n_sampled;
  }
}

#endif
#endif
