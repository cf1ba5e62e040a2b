#ifndef EXPLICIT_H
#define EXPLICIT_H
#include "energy.h"
#include "finite.h"
#include "first_step.h"
#include "extrapolate.h"
#include "sample.h"
#include "step_control.h"
#include "tableau.h"

/* Memory of one integration; from call to call it keeps rates[0], what rounding took, and the sides of events. */
typedef struct {
  real rates[N_STATES * METHOD_RATES], trial[N_STATES], old[N_OLD], lost[N_STATES], change[N_STATES], spare[N_STATES];
#if METHOD_HAS_DENSE
  real dense[N_STATES * METHOD_DENSE];
#endif
#if METHOD_HAS_MEMORY
  method_memory own;
#endif
#if WITH_EVENTS
  event_memory events;
#endif
#if METHOD_KEEPS_ENERGY
  energy_memory energy;
#endif
#if WITH_PROFILE
  real driven[N_DRIVEN];
#endif
} method_work;

/* One integration: where it is, what it calls, samples to fill, counters and memory. */
typedef struct {
  double rtol, atol;
  double *time, *step;
  real *state;
  const motion_arguments *with;
  const motion_samples *to;
  scene_run *run;
  method_work *work;
} method_motion;

#if METHOD_HAS_DENSE
/* State at fraction s of the step. */
static inline void method_interpolate(real s, const real *old, const real *dense, real *out)
{
  const real r = (real)1.0 - s;
  int k, power;
  for (k = 0; k < N_STATES; ++k) {
    real sum = dense[N_STATES * (METHOD_DENSE - 1) + k];
    for (power = METHOD_DENSE - 2; power >= 0; --power) {
      sum = dense[N_STATES * power + k] + (power % 2 == 0 ? r : s) * sum;
    }
    out[k] = old[k] + s * sum;
  }
}

/* Fill the samples before t1, on a step of length h from `old` at t0 that is ready for dense output; spare: n. */
static inline void method_sample_dense(
    double t0, double h, double t1, const real *old, const real *dense, const motion_arguments *with, real *spare,
    const motion_samples *to)
{
  (void)with;
  (void)spare;
  for (; motion_next_sample(to) < t1; ++*to->n_filled) {
    real *sample = to->state + *to->n_filled * N_STATES;
    method_interpolate((real)((motion_next_sample(to) - t0) / h), old, dense, sample);
#if WITH_CONSTRAINTS
#if WITH_PROFILE
    profile_set_time(motion_next_sample(to), with->profile);
#endif
    motion_project(sample, sample + N, with, spare);
#endif
  }
}

#endif
/* The start of a step: the state and its acceleration. */
static inline void method_keep_old(const real *state, const real *rates, real *old)
{
  int k;
  for (k = 0; k < N_STATES; ++k) {
    old[k] = state[k];
  }
  for (k = 0; k < N_SLOPES; ++k) {
    old[N_STATES + k] = rates[N + k];
  }
}

#if WITH_ADJOINT
enum { METHOD_TURNED = 4 + N_MOVED * (METHOD_STAGES + 1) }; /* place in a row of the tape of which cables turned */
#if WITH_MARGIN_JUMPS
enum { METHOD_TAPE = METHOD_TURNED + N_CABLE_MARGINS }; /* numbers of a row */
#else
enum { METHOD_TAPE = METHOD_TURNED };
#endif

/* Put the step of length h to t1 on the tape, with so many rates. Returns its row, NULL without a tape. */
static inline double *method_tape(double h, double t1, int kind, int n_rates, const method_motion *m)
{
  scene_run *run = m->run;
  double *row;
  int j, k;
  if (run->tape == NULL) {
    return NULL;
  }
  row = run->tape + run->n_taped++ * METHOD_TAPE;
  row[0] = *m->time;
  row[1] = t1;
  row[2] = h;
  row[3] = kind;
  for (k = 0; k < N_MOVED; ++k) {
    row[4 + k] = m->work->old[k];
  }
  for (j = 0; j < n_rates; ++j) {
    for (k = 0; k < N_MOVED; ++k) {
      row[4 + N_MOVED * (j + 1) + k] = m->work->rates[N_STATES * j + k];
    }
  }
  return row;
}

#endif
#if METHOD_HAS_ERROR
/* Choose a first step up to time_end, from how accelerations answer to small displacements. */
static inline void method_choose_step(double time_end, const method_motion *m)
{
  real *rates = m->work->rates, *found = rates + N_STATES, *trial = m->work->trial;
  double fastest = 0.0;
  int k;
#if WITH_VELOCITY
  const int rounds = 3;
#else
  const int rounds = 2;
#endif
  for (k = 0; k < rounds; ++k) {
    double response;
    motion_displace(1, k, m->state, rates, k ? found : rates, trial);
    motion_rate(trial, m->with, found);
    ++m->run->n_evaluations;
    response = motion_response(1, m->state, rates, trial, found);
    fastest = fmax(fastest, k == 2 ? response : sqrt(response));
  }
  *m->step = motion_first_step(
      1, time_end - *m->time, m->rtol, m->atol, METHOD_ERROR_ORDER, fastest, m->state, rates);
}

#endif
#if WITH_EVENTS
/* What is watched where the motion stands: margins and rates to events.start_margin and .start_rate. Zero if they are
 * not finite. */
static inline int method_evaluate_margins(double h, const method_motion *m, real *change)
{
  method_work *w = m->work;
  return motion_evaluate_margins(
      *m->time, h, m->state, w->lost, w->rates, change, w->trial, w->old, m->with, m->run, &w->events);
}

#if WITH_SET_STATES
/* Note in the state which contacts slip, and evaluate again what depends on it. Zero if margins are not finite. */
static inline int method_set_slips(const method_motion *m, real *change)
{
#if WITH_SETTLING
  event_settle(m->state, m->with, m->work->events.point);
#endif
  event_set_slips(&m->work->events, m->state);
  motion_rate(m->state, m->with, m->work->rates);
  ++m->run->n_evaluations;
  return method_evaluate_margins(m->run->usual_step, m, change);
}

#endif
/* Pass the event that lies `root` ahead, no farther than `near`, by extrapolation to just beyond it. Zero if nothing
 * turned. */
static inline int method_pass(double root, double near, double left, const method_motion *m)
{
  double h = fmin(root + near, left), t1;
  method_work *w = m->work;
  int k;
#if !WITH_SMOOTH_EVENTS
  double delay;
#endif
#if WITH_MOVED_PLACES
  double gap;
#endif
#if WITH_MARGIN_JUMPS
  real turned[N_CABLE_MARGINS];
#endif
#if WITH_ADJOINT
  double *row;
#endif
#if WITH_MOVED_PLACES
  for (;; h += gap) {
#endif
  /* The state at t1, just beyond the event, by a Taylor series, and the margins there. */
  t1 = h < left ? *m->time + h : *m->time + left;
  motion_extrapolate(h, m->state, w->lost, w->rates, w->change, w->trial);
#if WITH_PROFILE
  profile_set_time(t1, m->with->profile);
#endif
#if WITH_MOVED_PLACES
  event_margins(t1, w->trial, w->trial + N, m->with, m->run, w->events.trial_margin);
#endif
#if WITH_CONSTRAINTS
  motion_project(w->trial, w->trial + N, m->with, w->events.point);
#endif
  event_margins(t1, w->trial, w->trial + N, m->with, m->run, w->events.end_margin);
#if WITH_MOVED_PLACES
    gap = event_gap(w->events.trial_margin, &w->events);
    if (!(gap > 0.0 && h + gap <= left)) {
      break;
    }
  }
#endif
#if !WITH_SMOOTH_EVENTS
  delay = event_delay(fmax(2.0 * near, h - root), &w->events);
#endif
#if WITH_MARGIN_JUMPS
  for (k = 0; k < N_CABLE_MARGINS; ++k) {
    turned[k] = event_side_distance(&w->events, w->events.end_margin, k) < 0.0 ? -w->events.side[k] : 0.0;
  }
#endif
  if (!event_change_sides(*m->time + root, &w->events, w->events.end_margin, m->run)) {
    return 0;
  }
  /* Take the step, and note what rounding takes from x + dx. */
  method_keep_old(m->state, w->rates, w->old);
#if WITH_ADJOINT
  row = method_tape(h, t1, TAPED_EVENT, 1, m);
  (void)row;
#endif
  for (k = 0; k < N_STATES; ++k) {
    m->state[k] = w->trial[k];
    w->lost[k] = w->change[k] - (w->trial[k] - w->old[k]);
  }
#if WITH_SETTLING
  event_settle(m->state, m->with, w->events.point);
#endif
#if WITH_SET_STATES
  event_set_slips(&w->events, m->state);
#endif
#if WITH_PROFILE
  profile_set_time(t1, m->with->profile);
#endif
  motion_rate(m->state, m->with, w->rates);
#if !WITH_SMOOTH_EVENTS
  /* v += delay (a after - a before), as if the force had jumped at the root. */
  event_correct_velocity(delay, w->old + N_STATES, w->rates + N, m->state + N, w->lost + N);
#if WITH_COLUMN_JUMPS
  motion_jump_columns(turned, *m->time, t1, w->old, m->with, m->state);
#endif
#if WITH_ADJOINT
#if WITH_MARGIN_JUMPS
  for (k = 0; row != NULL && k < N_MOVED; ++k) {
    row[4 + 2 * N_MOVED + k] = m->state[k];
  }
  for (k = 0; row != NULL && k < N_CABLE_MARGINS; ++k) {
    row[METHOD_TURNED + k] = turned[k];
  }
#endif
#endif
  motion_rate(m->state, m->with, w->rates);
  ++m->run->n_evaluations;
#endif
  motion_sample(*m->time, h, t1, w->old, m->state, w->rates + N, m->with, w->events.point, m->to);
  event_count(*m->time + root, *m->step, m->run);
  *m->time = t1;
  ++m->run->n_accepted;
  ++m->run->n_evaluations;
  return 1;
}

/* The extrapolation over an event must cost no accuracy, nor end a run late. */
static inline double method_event_base(const method_motion *m)
{
#if WITH_COLUMNS
  /* The slopes of derivatives jump at kinks too. */
  return 1e-12 * m->run->usual_step + 1e-15 * fabs(*m->time);
#else
#if WITH_CONTACT_EVENTS
  /* Contacts are kinks, where forces do not jump. */
  if (!m->run->stop && event_is_kink(m->work->events.found_margin)) {
    return 1e-8 * m->run->usual_step + 1e-15 * fabs(*m->time);
  }
#endif
#if WITH_SMOOTH_EVENTS
  return (m->run->stop ? 1e-12 : 1e-8) * m->run->usual_step + 1e-15 * fabs(*m->time);
#else
  return 1e-12 * m->run->usual_step + 1e-15 * fabs(*m->time);
#endif
#endif
}

/* Whether the call goes on behind an event: SCENE_OK; `is_over` where it ends here by request. */
static inline int method_after_crossing(const scene_run *run, int *is_over)
{
  *is_over = run->is_stopped;
  return run->n_rapid_events > MAX_RAPID_EVENTS ? SCENE_TOO_MANY_EVENTS : SCENE_OK;
}

#if WITH_CONTACT_EVENTS
/* Length of a step that ends soon after a contact begins, at most `planned`; that time is extrapolated. What a longer
 * one finds below the ground, or with bars in bars, is no motion, and a whole contact could lie within it. */
static inline double method_limit_fall(double planned, const method_motion *m)
{
  method_work *w = m->work;
  event_memory *events = &w->events;
  event_path path;
  double first = 1.0;
  int k;
  path.start = w->old;
  path.end_coordinate = w->trial;
  path.end_velocity = w->trial + N;
  path.end_acceleration = w->rates + N;
  path.time = *m->time;
  path.length = planned;
  motion_extrapolate(planned, m->state, w->lost, w->rates, w->change, w->trial);
  event_margins_at(&path, 1.0, m->with, m->run, events->point, events->end_margin);
  for (k = FIRST_CONTACT; k < FIRST_CONTACT + N_CONTACTS; ++k) {
    const double distance = event_side_distance(events, events->end_margin, k);
    if (events->side[k] < 0.0 && distance < 0.0) {
      first = fmin(
          first,
          event_find_crossing(
              &path, k, 0.0, event_side_distance(events, events->start_margin, k), 1.0, distance, m->with, m->run,
              events));
    }
  }
  return first < 1.0 ? fmin(planned, (1.05 * first + 1e-12) * planned) : planned;
}

#endif
/* Where the motion stands just before an event: pass it, or choose where the next step is cut. */
static inline int method_meet_crossing(double left, const method_motion *m, int *is_over)
{
  const double base = method_event_base(m);
  method_work *w = m->work;
  scene_run *run = m->run;
  event_path path;
  double root, near;
#if METHOD_HAS_ERROR
  double *planned = m->step;
#else
  double length = *m->step, *planned = &length;
#endif
  path.start = w->old;
  path.end_coordinate = w->trial;
  path.end_velocity = w->trial + N;
  path.end_acceleration = w->rates + N;
  path.time = *m->time;
  path.length = fmin(fmax(4.0 * run->time_to_event, 4.0 * base), left);
  motion_extrapolate(path.length, m->state, w->lost, w->rates, w->change, w->trial);
  root = event_find_first(&path, 1, 0, m->with, run, &w->events) * path.length;
  near = event_tolerance(base, run->usual_step, &w->events);
  if (!event_can_be_passed(root, near, path.length, planned, run, &w->events)) {
    return SCENE_OK;
  }
  if (!method_pass(root, near, left, m)) {
    run->noise_factor *= 8.0;
    return SCENE_OK;
  }
  run->noise_factor = 1.0;
#if WITH_STIFFENING
#if METHOD_HAS_ERROR
  /* A contact vibrates faster than the structure in the air, and a member faster than in flow. */
  if (event_stiffens(w->events.found_margin) && w->events.side[w->events.found_margin] > 0.0) {
    const double before = *m->step;
    method_choose_step(*m->time + left, m);
    *m->step = fmin(before, *m->step);
  }
#endif
#endif
  if (!all_finite(w->rates, N_STATES) || !method_evaluate_margins(run->usual_step, m, w->change)) {
    return SCENE_NON_FINITE_RESULT;
  }
  return method_after_crossing(run, is_over);
}

/* Look for events on the step of length h to `trial`. Non-zero where the step has to be cut at one; is_landing: it
 * ends at one; error: INFINITY where margins are not finite. */
static inline int method_is_cut_short(
    double h, int is_cut, const method_motion *m, double *error, int *is_landing)
{
  method_work *w = m->work;
  event_memory *events = &w->events;
  event_path path;
  double found;
#if METHOD_HAS_DENSE
  const int parts = 2;
#else
  const int parts = m->run->condition != NULL ? 2 : 1;
#endif
  path.start = w->old;
  path.end_coordinate = w->trial;
  path.end_velocity = w->trial + N;
  path.end_acceleration = w->rates + N_STATES * METHOD_STAGES + N;
  path.time = *m->time;
  path.length = h;
  events->may_cut_at_turn = !is_cut;
  found = event_find_first(&path, parts, *error <= 1.0, m->with, m->run, events);
  if (!all_finite(events->end_margin, N_MARGINS)) {
    *error = INFINITY;
  } else if (found >= 0.0 && *error <= 1.0 && event_is_reached(m->run->usual_step, events)) {
    *is_landing = 1;
  } else if (found <= 1.0) {
    /* A step that was cut at the condition and meets it again meets noise, but where events are many. */
    const int is_noise = is_cut && events->found_margin == N_MARGINS - 1 && m->run->step_limit == 0.0;
    m->run->noise_factor *= is_noise ? 8.0 : 1.0;
    event_shorten_step(found, h, event_tolerance(method_event_base(m), m->run->usual_step, events), m->run);
    return 1;
  }
  return 0;
}

/* After a step of length h that was taken: margins at its end, and an event that it ended at. */
static inline int method_watch_on(
    double h, int is_whole, int is_cut, int is_landing, const method_motion *m, int *is_over)
{
  event_memory *events = &m->work->events;
  int k;
  if (m->run->watch && is_whole) {
    for (k = 0; k < N_MARGINS; ++k) {
      events->start_margin[k] = events->end_margin[k];
      events->start_rate[k] = events->end_slope[k] / h;
    }
    m->run->usual_step = h;
  } else if (m->run->watch && !method_evaluate_margins(m->run->usual_step, m, m->work->spare)) {
    return SCENE_NON_FINITE_RESULT; /* the slopes over a short step would be rounding */
  }
  event_after_step(*m->step, is_cut, is_landing, m->run);
  if (is_landing && event_change_sides(*m->time, events, events->start_margin, m->run)) {
    event_count(*m->time, *m->step, m->run);
#if WITH_SET_STATES
    if (!method_set_slips(m, m->work->spare)) {
      return SCENE_NON_FINITE_RESULT;
    }
#endif
    return method_after_crossing(m->run, is_over);
  }
  return SCENE_OK;
}

#endif
/* Before the first step: derivatives, a first step, the energy and the margins. */
static inline int method_begin(double time_end, const method_motion *m)
{
  method_work *w = m->work;
  scene_run *run = m->run;
  int k;
  (void)time_end;
  for (k = 0; k < N_STATES; ++k) {
    w->lost[k] = (real)0.0;
  }
#if WITH_PROFILE
  profile_set_time(*m->time, m->with->profile);
#endif
#if WITH_YIELD_EVENTS
  /* What flows is found anew: values may have jumped since the state was reached. */
  for (k = N_STATES - N_YIELDS; k < N_STATES; ++k) {
    m->state[k] = 0.0;
  }
#endif
#if WITH_SETTLING
  event_settle(m->state, m->with, w->spare);
#endif
  motion_rate(m->state, m->with, w->rates);
  ++run->n_evaluations;
  if (!all_finite(w->rates, N_STATES)) {
    return SCENE_NON_FINITE_RESULT;
  }
#if METHOD_HAS_ERROR
  if (!(*m->step > 0.0)) {
    method_choose_step(time_end, m);
  }
  run->may_grow = 1;
#endif
#if METHOD_KEEPS_ENERGY
  run->energy = motion_energy(m->state, m->state + N, m->with);
#endif
#if WITH_EVENTS
#if WITH_STATIC_FRICTION
  run->watch |= SCENE_EVENT_STICK; /* slip begins at an event */
#endif
#if WITH_YIELD_EVENTS
  run->watch |= SCENE_EVENT_YIELD;
#endif
  w->events.may_cut_at_turn = 0;
  w->events.found_margin = 0;
  if (run->watch && !method_evaluate_margins(*m->step, m, w->change)) {
    return SCENE_NON_FINITE_RESULT;
  }
  event_begin(*m->time, *m->step, run, &w->events);
#if WITH_SET_STATES
  if (!method_set_slips(m, w->change)) {
    return SCENE_NON_FINITE_RESULT;
  }
#endif
#endif
  run->is_started = 1;
  return SCENE_OK;
}

#if WITH_MOVED_PLACES
/* Bring `trial` onto the constraints, unless that would move a cable back to slack: the event shows on the way there. */
static inline void method_project_watched(double h, const method_motion *m)
{
  method_work *w = m->work;
  event_memory *events = &w->events;
  int k;
  for (k = 0; k < N_STATES; ++k) {
    events->point[k] = w->trial[k];
  }
  event_margins(*m->time + h, w->trial, w->trial + N, m->with, m->run, events->trial_margin);
  motion_project(w->trial, w->trial + N, m->with, w->spare);
  event_margins(*m->time + h, w->trial, w->trial + N, m->with, m->run, events->end_margin);
  for (k = 0; event_gap(events->trial_margin, events) > 0.0 && k < N_STATES; ++k) {
    w->trial[k] = events->point[k];
  }
}

#endif
/* Try a step of length h; returns the scaled error of `trial`, INFINITY where something is not finite. Its derivative
 * goes to rates[METHOD_STAGES], what rounding takes to `change`. */
static inline double method_attempt(double h, const method_motion *m)
{
  method_work *w = m->work;
  double error;
  int k;
#if WITH_FLOAT
  if (!(h < 1e38)) { /* a float holds no such step; it is tried again shorter */
    m->run->n_evaluations += METHOD_EVALUATIONS;
    return INFINITY;
  }
#endif
#if WITH_PROFILE
  profile_set_start(*m->time, m->with->profile);
#endif
#if METHOD_HAS_MEMORY
  error = method_try(
      (real)h, m->rtol, m->atol, m->state, m->with, w->lost, w->rates, w->change, w->trial, &w->own);
#else
#if METHOD_HAS_ERROR
  error = method_try((real)h, m->rtol, m->atol, m->state, m->with, w->lost, w->rates, w->change, w->trial);
#else
  error = method_try((real)h, m->state, m->with, w->lost, w->rates, w->change, w->trial);
#endif
#endif
#if METHOD_ITERATES
  m->run->n_evaluations += w->own.n_evaluations;
#else
  m->run->n_evaluations += METHOD_EVALUATIONS;
#endif
  if (!(error < INFINITY)) {
    return error;
  }
  for (k = 0; k < N_STATES; ++k) {
    w->change[k] -= w->trial[k] - m->state[k];
  }
#if WITH_PROFILE
  profile_set_stage(h, m->with->profile);
#endif
#if WITH_MOVED_PLACES
  if (m->run->watch) {
    method_project_watched(h, m);
  } else {
    motion_project(w->trial, w->trial + N, m->with, w->spare);
  }
#else
#if WITH_CONSTRAINTS
  motion_project(w->trial, w->trial + N, m->with, w->spare);
#endif
#endif
#if METHOD_HAS_LATE_END
#if METHOD_ENDS_WATCHED
  if (error <= 1.0 || m->run->watch) {
#else
  if (error <= 1.0) {
#endif
    real *end = w->rates + N_STATES * METHOD_STAGES;
    motion_rate(w->trial, m->with, end);
    ++m->run->n_evaluations;
    error = all_finite(end, N_STATES) ? error : INFINITY;
  }
#endif
  return error;
}

/* Fill the samples of the step of length h to `state` at t1. */
static inline void method_sample_step(double h, double t1, const method_motion *m)
{
  method_work *w = m->work;
  const motion_samples *to = m->to;
  int k;
#if METHOD_KEEPS_ENERGY
  long long first = *to->n_filled;
#endif
#if METHOD_HAS_DENSE
  const int is_between = motion_next_sample(to) < t1;
  if (is_between) {
    method_prepare((real)h, w->old, m->with, w->trial, w->spare, w->rates, w->dense);
    m->run->n_evaluations += METHOD_DENSE_ROWS;
  }
#endif
  for (k = 0; k < N_STATES; ++k) {
    w->rates[k] = w->rates[N_STATES * METHOD_STAGES + k];
  }
#if METHOD_HAS_DENSE
  if (is_between) {
    method_sample_dense(*m->time, h, t1, w->old, w->dense, m->with, w->spare, to);
  }
#endif
  motion_sample(*m->time, h, t1, w->old, m->state, w->rates + N, m->with, w->spare, to);
#if METHOD_KEEPS_ENERGY
  for (; m->run->keeps_energy && first < *to->n_filled; ++first) {
    motion_keep_energy(m->run->energy, to->state + first * N_STATES, m->with, &w->energy);
  }
#endif
}

/* Take the step of length h to `trial` at t1. */
static inline void method_take(double h, double t1, const method_motion *m)
{
  method_work *w = m->work;
  int k;
#if WITH_ADJOINT
  method_tape(h, t1, TAPED_STEP, METHOD_STAGES, m);
#endif
  for (k = 0; k < N_STATES; ++k) {
    m->state[k] = w->trial[k];
    w->lost[k] = w->change[k];
  }
#if METHOD_KEEPS_ENERGY
  if (m->run->keeps_energy) {
    real *end = w->rates + N_STATES * METHOD_STAGES;
    motion_keep_energy(m->run->energy, m->state, m->with, &w->energy);
#if WITH_CONSTRAINTS
    motion_rate(m->state, m->with, end);
    ++m->run->n_evaluations;
#else
    for (k = 0; k < N; ++k) {
      end[k] = m->state[N + k];
    }
#endif
  }
#endif
  method_sample_step(h, t1, m);
  *m->time = t1;
  ++m->run->n_accepted;
}

#if METHOD_HAS_ERROR
/* After a step of length h with more than the error allowed: a shorter one, unless no time can resolve it. */
static inline int method_reject(double h, double error, const method_motion *m)
{
  ++m->run->n_rejected;
  *m->step = step_after_rejection(h, error, METHOD_ERROR_ORDER);
  m->run->may_grow = 0;
#if WITH_EVENTS
  m->run->step_to_event = 0.0;
#endif
  if (*m->step <= 4e-16 * fabs(*m->time) || *m->step < SMALLEST_STEP) {
    return error < INFINITY ? SCENE_STEP_TOO_SMALL : SCENE_NON_FINITE_RESULT;
  }
  return SCENE_OK;
}

#endif
/* One trial: a step towards time_end, or what an event asks for in its place. */
static inline int method_trial(double time_end, const method_motion *m, int *is_over)
{
  const double left = time_end - *m->time;
  double h = *m->step, t1, error;
  int is_last, is_cut = 0, is_short = 0;
#if WITH_EVENTS
  int is_landing = 0;
#endif
  method_keep_old(m->state, m->work->rates, m->work->old);
#if WITH_EVENTS
  if (!event_may_continue(*m->time, *m->step, m->run)) {
    return SCENE_TOO_MANY_EVENTS;
  }
  if (m->run->watch) {
    event_set_noise(m->state, m->run->noise_factor, m->run->usual_step, &m->work->events);
  }
  if (m->run->time_to_event > 0.0) {
    return method_meet_crossing(left, m, is_over);
  }
  h = event_limit_step(h, m->run, &is_short, &is_cut);
#if WITH_CONTACT_EVENTS
  if (m->run->watch && !is_cut) {
    const double planned = fmin(h, left);
    h = method_limit_fall(planned, m);
    is_short = is_short || h < planned;
  }
#endif
#endif
#if METHOD_HAS_ERROR
  is_last = h >= left;
#else
  is_last = h >= left || !(is_cut || is_short);
#endif
  h = is_last ? left : h;
  t1 = is_last ? time_end : *m->time + h;
#if WITH_FLOAT
#if METHOD_HAS_ERROR
  if (h < SMALLEST_STEP) {
    return SCENE_STEP_TOO_SMALL;
  }
#endif
#endif
  error = method_attempt(h, m);
#if WITH_EVENTS
  if (m->run->watch && error < INFINITY && method_is_cut_short(h, is_cut, m, &error, &is_landing)) {
    return SCENE_OK;
  }
#endif
#if METHOD_HAS_ERROR
  if (!(error <= 1.0)) {
    return method_reject(h, error, m);
  }
#else
  if (!(error <= 1.0)) {
    return SCENE_NON_FINITE_RESULT;
  }
#endif
  method_take(h, t1, m);
#if METHOD_HAS_ERROR
  /* Do not let a step that was cut set the pace, nor grow right after a rejection. */
  if (!is_last && !is_cut && !is_short) {
    scene_run *run = m->run;
    *m->step = run->follows_two_errors
        ? step_by_two_errors(h, error, &run->last_error, METHOD_ERROR_ORDER, run->may_grow)
        : step_after_success(h, error, METHOD_ERROR_ORDER, run->may_grow);
  }
  m->run->may_grow = 1;
#endif
#if WITH_EVENTS
#if METHOD_HAS_ERROR
  return method_watch_on(h, !is_cut && !is_short && !is_last, is_cut, is_landing, m, is_over);
#else
  return method_watch_on(h, !is_cut && !is_short && h > 0.5 * *m->step, is_cut, is_landing, m, is_over);
#endif
#else
  (void)is_over;
  return SCENE_OK;
#endif
}

/* On to time_end, in at most so many trials. */
static inline int method_advance(double time_end, long long most_trials, const method_motion *m)
{
  int status = SCENE_OK, is_over = 0;
  long long i;
#if WITH_EVENTS
  m->run->is_stopped = 0;
#endif
  if (!m->run->is_started && *m->time < time_end) { /* no time tells no first step */
    status = method_begin(time_end, m);
  }
  for (i = 0; status == SCENE_OK && !is_over && i < most_trials && *m->time < time_end; ++i) {
#if WITH_ADJOINT
    if (m->run->tape != NULL && m->run->n_taped >= m->run->most_taped) {
      break;
    }
#endif
    status = method_trial(time_end, m, &is_over);
  }
  return status;
}

#if WITH_PROFILE
/* Behind a kink of the profile: derivatives anew, and margins, of which some may have changed sides at a jump. */
static inline int method_pass_kink(const method_motion *m)
{
  method_work *w = m->work;
  profile_enter(*m->time, m->with->profile);
  motion_rate(m->state, m->with, w->rates);
  ++m->run->n_evaluations;
  if (!all_finite(w->rates, N_STATES)) {
    return SCENE_NON_FINITE_RESULT;
  }
#if WITH_EVENTS
  m->run->time_to_event = 0.0;
  m->run->step_to_event = 0.0;
  if (m->run->watch) {
    if (!method_evaluate_margins(m->run->usual_step, m, w->spare)) {
      return SCENE_NON_FINITE_RESULT;
    }
    event_set_noise(m->state, m->run->noise_factor, m->run->usual_step, &w->events);
    if (event_change_sides(*m->time, &w->events, w->events.start_margin, m->run)) {
      int is_over;
      event_count(*m->time, *m->step, m->run);
#if WITH_SET_STATES
      if (!method_set_slips(m, w->spare)) {
        return SCENE_NON_FINITE_RESULT;
      }
#endif
      return method_after_crossing(m->run, &is_over);
    }
  }
#endif
  return SCENE_OK;
}

/* On to time_end, in at most so many trials, with steps that end at the kinks of the profile. */
static inline int method_follow(double time_end, long long most_trials, const method_motion *m)
{
  const scene_run *run = m->run;
  motion_profile *profile = m->with->profile;
  const long long most = most_trials > LLONG_MAX - run->n_accepted - run->n_rejected
      ? LLONG_MAX
      : run->n_accepted + run->n_rejected + most_trials;
  int status, is_over = 0;
  if (profile == NULL) {
    return method_advance(time_end, most_trials, m);
  }
  if (profile->high < 0) {
    profile_enter(*m->time, profile);
  }
  do {
    const double kink = profile_kink(profile);
    status = method_advance(fmin(time_end, kink), most - run->n_accepted - run->n_rejected, m);
    if (status == SCENE_OK && *m->time >= kink) {
      status = method_pass_kink(m);
    }
#if WITH_EVENTS
    is_over = run->is_stopped;
#endif
#if WITH_ADJOINT
    is_over |= run->tape != NULL && run->n_taped >= run->most_taped;
#endif
  } while (status == SCENE_OK && !is_over && *m->time < time_end && run->n_accepted + run->n_rejected < most);
  return status;
}

#endif

#endif
