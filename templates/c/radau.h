#ifndef RADAU_H
#define RADAU_H
#include "radau_events.h"
#include "radau_smooth.h"
#if !WITH_FLOAT

/* The integrator radau: steps of Radau IIA with three stages, each from the smooth motion before it. */

/* Integrate from *time to time_end, in at most so many trial steps, with quiet vibrations up to `quiet` [m]. Fills the
 * samples that lie within; vibration: see radau_find_vibration; count: steps taken, rejected, not converged, ... */
static inline int radau_advance(
    double time_end, long long most_steps, double quiet, double *time, double *step, double *state, long long n_samples,
    const double *sample_time, double *sample_state, double *sample_tension, long long *n_sampled, long long *count,
    double *vibration,
#if WITH_EVENTS
    scene_run *events,
#endif
    radau_work *run)
{
#if WITH_EVENTS
  event_memory *m = &run->margins;
  const int watches = events != NULL && events->watch;
#endif
  long long i;
  int k;
  /* Newton's method may leave a part of the tolerance that shrinks as the errors of steps do beside their estimates. */
  run->share = radau_newton_share * fmin(1.0, sqrt((run->rtol > 0.0 ? run->rtol : run->atol) / radau_share_tolerance));
  run->count = count;
#if WITH_EVENTS
  m->may_cut_at_turn = 0;
  m->found_margin = 0;
  if (events != NULL) {
    events->is_stopped = 0;
  }
#endif
  if (!(*step > 0.0) || count[0] + count[1] + count[2] == 0) {
    for (k = 0; k < RADAU_COUNTS; ++k) {
      count[k] = 0;
    }
#if WITH_PROFILE
    profile_set_start(*time, run->with->profile);
    profile_set_stage(0.0, run->with->profile);
#endif
    radau_prepare(run);
    if (!all_finite(run->law, RADAU_LAW) || !all_finite(run->mass, RADAU_MASSES)) {
      return SCENE_NON_FINITE_RESULT;
    }
    if (!radau_begin(run, time_end - *time, quiet, step, state, vibration)) {
      return SCENE_NON_FINITE_RESULT;
    }
#if WITH_EVENTS
    if (watches) {
      events->usual_step = *step;
      if (!radau_evaluate_margins(run, *time, state, events, m)) {
        return SCENE_NON_FINITE_RESULT;
      }
      event_begin(*time, *step, events, m);
    }
#endif
    /* Samples that are there already are of the start. */
    for (i = 0; i < *n_sampled; ++i) {
      for (k = 0; k < N_TENSIONS; ++k) {
        sample_tension[i * N_TENSIONS + k] = run->compliance[k] > 0.0 ? run->stage_tension[k] : run->tension[k];
      }
    }
  }
  for (i = 0; i < most_steps && *time < time_end; ++i) {
    const double left = time_end - *time, kept_step = run->kept[RADAU_KEPT_USUAL_STEP];
    const double usual_step = fmin(kept_step > 0.0 ? kept_step : *step, *step);
    double h = *step, t1, error = -1.0, factor;
#if WITH_EVENTS
    int is_cut = 0, is_short = 0, is_landing = 0, is_known = 1;
#endif
    int is_last, is_whole;
#if WITH_EVENTS
    if (watches) {
      if (!event_may_continue(*time, *step, events)) {
        return SCENE_TOO_MANY_EVENTS;
      }
      event_set_noise(state, events->noise_factor, 0.0, m);
      if (events->time_to_event > 0.0) {
        if (!radau_event_pass(
                run, left, step, time, state, n_samples, sample_time, sample_state, sample_tension, n_sampled, events,
                m)) {
          return SCENE_NON_FINITE_RESULT;
        }
        if (events->n_rapid_events > MAX_RAPID_EVENTS) {
          return SCENE_TOO_MANY_EVENTS;
        }
        if (events->is_stopped) {
          radau_store_last_tensions(run, n_samples, sample_tension, n_sampled);
          return SCENE_OK;
        }
        continue;
      }
      h = event_limit_step(h, events, &is_short, &is_cut);
    }
#endif
    is_last = h >= left;
    h = is_last ? left : h;
    t1 = is_last ? time_end : *time + h;
#if WITH_EVENTS
    is_whole = !is_last && !is_cut && !is_short;
#else
    is_whole = !is_last;
#endif
#if WITH_PROFILE
    profile_set_start(*time, run->with->profile);
#endif
    radau_weigh(run, h, state);
#if WITH_RADAU_DAMPED
    radau_find_damped(run, state, state + N);
#endif
    if (radau_factor_step(run, h) && radau_newton(run, h, state)) {
      for (k = 0; k < N; ++k) {
        run->trial[k] = state[k] + run->increment[2 * N + k];
        run->trial[N + k] = run->stage_velocity[2 * N + k];
      }
      error = radau_error(run, h, state, run->trial);
    }
    factor = error > 0.0 ? 0.9 * pow(error, -0.25) : error < 0.0 ? 0.5 : 8.0;
    if (error >= 0.0 && error <= 1.0 && !radau_smooth_end(run, h, is_whole ? h : usual_step, state)) {
      error = INFINITY;
    }
#if WITH_EVENTS
    if (watches && error >= 0.0 && error < INFINITY) {
      const int is_good = error <= 1.0;
      double found;
      m->may_cut_at_turn = !is_cut;
      found = radau_event_search(
          run, *time, h, is_good ? run->velocity : run->stage_velocity + 2 * N,
          is_good ? run->acceleration : run->stage_acceleration + 2 * N, is_good, events, m);
      is_known = all_finite(m->end_margin, N_MARGINS);
      if (!is_known) {
        error = INFINITY;
      } else if (found >= 0.0 && is_good && event_is_reached(events->usual_step, m)) {
        is_landing = 1;
      }
      if (is_good && !is_landing && (found <= 1.0 || !(error <= 1.0))) {
        radau_revert(run, *step, state);
      }
      if (is_known && !is_landing && found <= 1.0) {
        event_shorten_step(found, h, radau_reach(run, events->usual_step), events);
        ++count[1];
        continue;
      }
    }
#endif
    if (!(error >= 0.0 && error <= 1.0)) {
      ++count[error < 0.0 ? 2 : 1];
      *step = h * (error < INFINITY ? fmax(0.1, factor) : 0.1);
      run->kept[RADAU_KEPT_MAY_GROW] = 0.0;
#if WITH_EVENTS
      if (events != NULL) {
        events->step_to_event = 0.0;
      }
#endif
      if (*step <= 4e-16 * fabs(*time) || *step < 1e-300) {
        int is_finite_step = all_finite(run->residual, 3 * N_UNKNOWNS);
#if WITH_EVENTS
        is_finite_step = is_finite_step && is_known;
#endif
        return is_finite_step ? SCENE_STEP_TOO_SMALL : SCENE_NON_FINITE_RESULT;
      }
      continue;
    }
    factor *= (2 * RADAU_MOST_ITERATIONS + 1)
        / ((double)(2 * RADAU_MOST_ITERATIONS) + run->kept[RADAU_KEPT_ITERATIONS]);
    if (run->kept[RADAU_KEPT_STEP] > 0.0 && run->kept[RADAU_KEPT_MAY_GROW] > 0.0 && error > 0.0) {
      /* Gustafsson 1994: errors that grow from step to step go on growing. */
      const double ratio = run->kept[RADAU_KEPT_ERROR] / (error * error);
      factor = fmin(factor, 0.9 * h / run->kept[RADAU_KEPT_STEP] * pow(ratio, 0.25));
    }
    radau_accept_step(run, h, *time, t1, state, n_samples, sample_time, sample_state, sample_tension, n_sampled);
    *time = t1;
    ++count[0];
#if WITH_EVENTS
    if (watches && h >= 0.5 * usual_step) {
      radau_find_jerk(run, h);
    }
#endif
    /* The polynomials of a step that was cut short say nothing of a long one. */
    run->kept[RADAU_KEPT_STEP] = h >= 0.1 * usual_step ? h : 0.0;
    run->kept[RADAU_KEPT_ERROR] = fmax(error, 1e-2);
    if (is_whole) {
      *step = h * fmin(run->kept[RADAU_KEPT_MAY_GROW] > 0.0 ? 8.0 : 1.0, fmax(0.2, factor));
      run->kept[RADAU_KEPT_USUAL_STEP] = h;
    }
    run->kept[RADAU_KEPT_MAY_GROW] = 1.0;
#if WITH_EVENTS
    if (watches) {
      if (!radau_update_events(run, t1, *step, h, is_whole, is_cut, is_landing, state, events, m)) {
        return SCENE_NON_FINITE_RESULT;
      }
      if (events->n_rapid_events > MAX_RAPID_EVENTS) {
        return SCENE_TOO_MANY_EVENTS;
      }
      if (events->is_stopped) {
        radau_store_last_tensions(run, n_samples, sample_tension, n_sampled);
        return SCENE_OK;
      }
    }
#endif
  }
  return SCENE_OK;
}

#endif
#endif
