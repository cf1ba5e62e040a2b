/* Values, modes, steps and derivatives of an instance; nothing here knows which version of the standard calls. */
#ifndef FMU_CORE_H
#define FMU_CORE_H
#include "fmu.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Send a message to the importer; events only where it has switched logging on. */
static void fmu_report(fmu_instance *instance, int status, const char *category, const char *format, ...)
{
  char text[512];
  va_list items;
  if (instance->report == NULL || (status == FMU_OK && !instance->is_logging)) {
    return;
  }
  va_start(items, format);
  vsnprintf(text, sizeof text, format, items);
  va_end(items);
  instance->report(instance, status, category, text);
}

/* FMU_OK where `function` may be called now; allowed: sum of modes. */
static int fmu_check_mode(fmu_instance *instance, int allowed, const char *function)
{
  if (instance == NULL) {
    return FMU_ERROR;
  }
  if (!(instance->now.mode & allowed)) {
    fmu_report(instance, FMU_ERROR, "logStatusError", "%s is not allowed in this mode of the instance", function);
    return FMU_ERROR;
  }
  return FMU_OK;
}

/* Values that were computed no longer belong to the state. */
static void fmu_forget(fmu_instance *instance)
{
  memset(instance->is_known, 0, sizeof instance->is_known);
  instance->is_rate_known = 0;
}

/* Back to what the model description says, as just after instantiation. */
static void fmu_reset(fmu_instance *instance)
{
  fmu_memory *m = &instance->now;
  const int is_exchange = m->is_exchange;
  memset(m, 0, sizeof *m);
  memcpy(m->token, FMU_TOKEN, sizeof FMU_TOKEN);
  m->is_exchange = is_exchange;
  m->mode = FMU_INSTANTIATED;
  m->rtol = FMU_RTOL;
  m->is_stale = 1;
  fmu_set_start(m->argument, m->state);
  fmu_forget(instance);
}

/* Turn the status of a function of the library into one of the standard, with a message. */
static int fmu_translate(fmu_instance *instance, int status, const char *what)
{
  if (status == FMU_LIBRARY_OK) {
    return FMU_OK;
  }
  fmu_report(
      instance, FMU_DISCARD, "logStatusDiscard", "%s at t = %.17g s: %s", what, instance->now.time,
      status > 0 && status < FMU_N_STATUSES ? fmu_status_text[status] : "unknown status");
  return status == FMU_LIBRARY_NON_FINITE_INPUT || status == FMU_LIBRARY_NULL_POINTER ? FMU_ERROR : FMU_DISCARD;
}

/* Compute a block of values unless it is known. */
static int fmu_need_block(fmu_instance *instance, int block)
{
  int status = FMU_OK;
  if (!instance->is_known[block]) {
    const int found = fmu_compute_block(block, instance->now.argument, instance->now.state, instance->value);
    status = fmu_translate(instance, found, "outputs cannot be computed");
    instance->is_known[block] = status == FMU_OK;
  }
  return status;
}

static int fmu_need_rates(fmu_instance *instance)
{
  int status = FMU_OK, k;
  if (!instance->is_rate_known) {
    const fmu_memory *m = &instance->now;
    for (k = 0; k < FMU_N_COORDINATES; ++k) {
      instance->rate[k] = m->state[FMU_N_COORDINATES + k];
    }
    status = fmu_translate(
        instance, fmu_compute_acceleration(m->argument, m->state, instance->rate + FMU_N_COORDINATES),
        "derivatives cannot be computed");
    instance->is_rate_known = status == FMU_OK;
  }
  return status;
}

static int fmu_get_rates(fmu_instance *instance, double *rate)
{
  const int status = fmu_need_rates(instance);
  if (status == FMU_OK) {
    memcpy(rate, instance->rate, sizeof instance->rate);
  }
  return status;
}

/* Margins of all events: each cable pulls, each node presses and sticks, while its margin is positive. */
static int fmu_get_margins(fmu_instance *instance, double *margin)
{
  int k, status = FMU_OK;
  for (k = FMU_N_BLOCKS - FMU_N_MARGIN_BLOCKS; status == FMU_OK && k < FMU_N_BLOCKS; ++k) {
    status = fmu_need_block(instance, k);
  }
  for (k = 0; status == FMU_OK && k < FMU_N_MARGINS; ++k) {
    margin[k] = instance->value[FMU_N_VALUES - FMU_N_MARGINS + k];
  }
  return status;
}

/* Event indicators: margins with a band around zero, so that an event that the importer finds exactly at zero still
 * changes the discrete value, and the next one has a sign to start from. */
static int fmu_get_indicators(fmu_instance *instance, double *indicator)
{
  int k;
  const int status = fmu_get_margins(instance, indicator);
  for (k = 0; status == FMU_OK && k < FMU_N_MARGINS; ++k) {
    indicator[k] += instance->now.is_slack[k] ? -FMU_BAND : FMU_BAND;
  }
  return status;
}

static int fmu_refuse(fmu_instance *instance, size_t reference, const char *why)
{
  fmu_report(instance, FMU_ERROR, "logStatusError", "value reference %lu: %s", (unsigned long)reference, why);
  return FMU_ERROR;
}

static int fmu_get_number(fmu_instance *instance, size_t reference, double *value)
{
  int k = 0, status;
  if (reference == FMU_TIME) {
    *value = instance->now.time;
  } else if (reference < FMU_STATE) {
    *value = instance->now.argument[reference - FMU_ARGUMENT];
  } else if (reference < FMU_RATE) {
    *value = instance->now.state[reference - FMU_STATE];
  } else if (reference < FMU_VALUE) {
    status = fmu_need_rates(instance);
    *value = status == FMU_OK ? instance->rate[reference - FMU_RATE] : NAN;
    return status;
  } else if (reference < FMU_SLACK) {
    const int place = (int)(reference - FMU_VALUE);
    while (place >= fmu_block_start[k + 1]) {
      ++k;
    }
    status = fmu_need_block(instance, k);
    *value = status == FMU_OK ? instance->value[place] : NAN;
    return status;
  } else {
    return fmu_refuse(instance, reference, "there is no real number with it");
  }
  return FMU_OK;
}

static int fmu_get_flag(fmu_instance *instance, size_t reference, int *value)
{
  if (reference < FMU_SLACK || reference >= FMU_EVENT_COUNT) {
    return fmu_refuse(instance, reference, "there is no Boolean with it");
  }
  if ((instance->now.mode & (FMU_STEP | FMU_TERMINATED)) && !instance->now.is_exchange
      && fmu_update_slack(instance, 0) != FMU_OK) {
    return FMU_DISCARD;
  }
  *value = instance->now.is_slack[reference - FMU_SLACK];
  return FMU_OK;
}

static int fmu_get_count(fmu_instance *instance, size_t reference, int *value)
{
  if (reference != FMU_EVENT_COUNT) {
    return fmu_refuse(instance, reference, "there is no integer with it");
  }
  *value = instance->now.n_events;
  return FMU_OK;
}

/* NULL where an argument may have this value, else what it may be. */
static const char *fmu_check_argument(int place, double value)
{
  if (!(value - value == 0.0)) {
    return "the value is not finite";
  }
  if (fmu_argument_least[place] == FMU_ABOVE_ZERO && !(value > 0.0)) {
    return "the value is not above zero";
  }
  return fmu_argument_least[place] == FMU_FROM_ZERO && !(value >= 0.0) ? "the value is negative" : NULL;
}

/* Set an input, a parameter or, until the end of the initialization, a state. */
static int fmu_set_number(fmu_instance *instance, size_t reference, double value)
{
  fmu_memory *m = &instance->now;
  const char *why = value - value == 0.0 ? NULL : "the value is not finite";
  double *place;
  if (reference >= FMU_ARGUMENT && reference < FMU_STATE) {
    why = fmu_check_argument((int)(reference - FMU_ARGUMENT), value);
    if (m->mode == FMU_CONTINUOUS && reference >= FMU_ARGUMENT + FMU_N_INPUTS) {
      return fmu_refuse(instance, reference, "parameters cannot be set in continuous-time mode");
    }
    place = m->argument + (reference - FMU_ARGUMENT);
  } else if (reference >= FMU_STATE && reference < FMU_RATE) {
    if (!(m->mode & (FMU_INSTANTIATED | FMU_INITIALIZATION))) {
      return fmu_refuse(instance, reference, "states can be set until the end of the initialization only");
    }
    place = m->state + (reference - FMU_STATE);
  } else {
    return fmu_refuse(instance, reference, "there is no real number with it that can be set");
  }
  if (why != NULL) {
    return fmu_refuse(instance, reference, why);
  }
  if (*place != value) {
    *place = value;
    m->is_stale = 1;
    fmu_forget(instance);
  }
  return FMU_OK;
}

static int fmu_set_states(fmu_instance *instance, const double *state)
{
  int k;
  for (k = 0; k < FMU_N_STATES; ++k) {
    if (!(state[k] - state[k] == 0.0)) {
      fmu_report(instance, FMU_DISCARD, "logStatusDiscard", "continuous state %d is not finite", k);
      return FMU_DISCARD;
    }
  }
  memcpy(instance->now.state, state, sizeof instance->now.state);
  fmu_forget(instance);
  return FMU_OK;
}

/* Give the discrete values those that belong to the state; counts: changes are events, at the zeros of indicators. */
static int fmu_update_slack(fmu_instance *instance, int counts)
{
  double margin[FMU_N_MARGINS + 1];
  fmu_memory *m = &instance->now;
  int k;
  const int status = fmu_get_margins(instance, margin);
  for (k = 0; status == FMU_OK && k < FMU_N_MARGINS; ++k) {
    const int is_slack = !counts           ? margin[k] < 0.0
                         : m->is_slack[k] ? margin[k] - FMU_BAND < 0.0
                                          : margin[k] + FMU_BAND <= 0.0;
    if (counts && is_slack != m->is_slack[k]) {
      ++m->n_events;
      fmu_report(
          instance, FMU_OK, "logEvents", "%s %s at t = %.17g s", fmu_margin_name[k],
          fmu_event_word[fmu_margin_kind[k]][!is_slack], m->time);
    }
    m->is_slack[k] = is_slack;
  }
  return status;
}

static int fmu_leave_initialization(fmu_instance *instance)
{
  fmu_memory *m = &instance->now;
  const int status = fmu_update_slack(instance, 0);
  if (status == FMU_OK) {
    m->mode = m->is_exchange ? FMU_EVENT : FMU_STEP;
  }
  return status;
}

/* FMU_OK where a step of this size may be taken from this point. */
static int fmu_check_step(fmu_instance *instance, double point, double size)
{
  const fmu_memory *m = &instance->now;
  const double end = point + size;
  if (!(size >= 0.0) || !(end - end == 0.0)) {
    fmu_report(instance, FMU_ERROR, "logStatusError", "the communication step %.17g s is not a finite length", size);
    return FMU_ERROR;
  }
  if (!(fabs(point - m->time) <= 1e-9 * (fabs(m->time) + size))) {
    fmu_report(
        instance, FMU_ERROR, "logStatusError", "the communication point %.17g s is not the time of the unit, %.17g s",
        point, m->time);
    return FMU_ERROR;
  }
  return FMU_OK;
}

/* Let the integration begin anew at the communication point. */
static void fmu_begin_here(fmu_memory *m)
{
  fmu_front *f = &m->front;
  f->time = m->time;
  memcpy(f->state, m->state, sizeof f->state);
  f->n_samples = 0;
  f->n_sampled = 0;
  f->n_used = 0;
  f->n_events = 0;
  fmu_begin(&f->integration);
  m->is_stale = 0;
}

/* Whether the state at `end` is among those that are known ahead; it becomes that of the communication point. */
static int fmu_take_sample(fmu_memory *m, double end)
{
  fmu_front *f = &m->front;
  while (f->n_used < f->n_sampled) {
    const double apart = f->sample_time[f->n_used] - end, same = 1e-12 * (fabs(end) + fabs(end - m->time));
    if (apart > same) {
      return 0;
    }
    ++f->n_used;
    if (apart >= -same) {
      memcpy(m->state, f->sample + (f->n_used - 1) * FMU_N_STATES, sizeof m->state);
      return 1;
    }
  }
  return 0;
}

/* Count and log the events up to the communication point. */
static void fmu_pass_events(fmu_instance *instance)
{
  fmu_memory *m = &instance->now;
  fmu_front *f = &m->front;
  int k, n_left = 0;
  for (k = 0; k < f->n_events; ++k) {
    const fmu_event event = f->event[k];
    if (event.time > m->time) {
      f->event[n_left++] = event;
    } else {
      const char *name;
      const int kind = fmu_find_kind(&event, &name);
      ++m->n_events;
      fmu_report(
          instance, FMU_OK, "logEvents", "%s %s at t = %.17g s", name, fmu_event_word[kind][event.direction > 0],
          event.time);
    }
  }
  f->n_events = n_left;
}

/* One call of the integrator. */
static int fmu_advance(fmu_memory *m, double time_end, long long most_steps)
{
  fmu_front *f = &m->front;
  long long n_events = 0;
  const int n_free = FMU_MOST_EVENTS - f->n_events;
  const int status = fmu_integrate(
      time_end, m->rtol, m->rtol * FMU_ATOL_RATIO, most_steps, &f->time, f->state, m->argument, f->n_samples,
      f->sample_time, f->sample, &f->n_sampled, f->event + f->n_events, n_free, &n_events, &f->integration);
  if (n_events > n_free) {
    m->n_events += (int)n_events - n_free; /* too many to be kept; they count at once */
    n_events = n_free;
  }
  f->n_events += (int)n_events;
  return status;
}

/* Integrate until the state at `end` is known. is_steady: nothing has been set since the last step, and the integrator
 * is not behind `end`; is_known: whether it came there. */
static int fmu_reach(fmu_memory *m, double end, double size, int is_steady, int *is_known)
{
  fmu_front *f = &m->front;
  long long i;
  int k, status = FMU_LIBRARY_OK;
  f->n_samples = 0;
  f->n_sampled = 0;
  f->n_used = 0;
  if (is_steady && f->integration.step > size && f->time < end) {
    f->n_samples = FMU_AHEAD;
    for (k = 0; k < FMU_AHEAD; ++k) {
      f->sample_time[k] = end + k * size;
    }
    for (i = 0; i < FMU_MOST_STEPS && status == FMU_LIBRARY_OK && f->time < end; ++i) {
      status = fmu_advance(m, f->sample_time[FMU_AHEAD - 1], 1);
    }
    *is_known = fmu_take_sample(m, end);
    if (*is_known) {
      return FMU_LIBRARY_OK;
    }
    if (f->time > end) {
      fmu_begin_here(m); /* the integrator has no state there */
    }
    f->n_samples = 0;
    f->n_sampled = 0;
  }
  if (status == FMU_LIBRARY_OK) {
    status = fmu_advance(m, end, FMU_MOST_STEPS);
  }
  *is_known = status == FMU_LIBRARY_OK && f->time >= end;
  memcpy(m->state, f->state, sizeof m->state);
  return status;
}

/* Integrate from the communication point over the communication step. */
static int fmu_do_step(fmu_instance *instance, double point, double size)
{
  fmu_memory *m = &instance->now;
  fmu_front *f = &m->front;
  const double end = point + size;
  int status = fmu_check_step(instance, point, size), is_known;
  if (status != FMU_OK || !(end > m->time)) {
    return status;
  }
  is_known = !m->is_stale && f->n_used < f->n_sampled && fmu_take_sample(m, end);
  if (!is_known) {
    const int is_steady = !m->is_stale && f->time <= end;
    if (!is_steady) {
      fmu_begin_here(m); /* a value has been set, or this is another point than those expected */
    }
    status = fmu_reach(m, end, size, is_steady, &is_known);
  }
  fmu_forget(instance);
  m->time = is_known ? end : f->time;
  fmu_pass_events(instance);
  if (status == FMU_LIBRARY_OK && m->time < end) {
    fmu_report(
        instance, FMU_DISCARD, "logStatusDiscard", "more than %lld steps are needed to reach t = %.17g s",
        (long long)FMU_MOST_STEPS, end);
    return FMU_DISCARD;
  }
  return fmu_translate(instance, status, "the integration stops");
}

/* A copy of what changes, to come back to. */
static int fmu_store(fmu_instance *instance, void **stored)
{
  if (*stored == NULL) {
    *stored = instance->allocate(1, sizeof(fmu_memory));
  }
  if (*stored == NULL) {
    fmu_report(instance, FMU_ERROR, "logStatusError", "there is no memory for the state of the unit");
    return FMU_ERROR;
  }
  memcpy(*stored, &instance->now, sizeof(fmu_memory));
  return FMU_OK;
}

static int fmu_check_stored(fmu_instance *instance, const void *stored, size_t size)
{
  if (stored == NULL || size != sizeof(fmu_memory) || memcmp(stored, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
    fmu_report(instance, FMU_ERROR, "logStatusError", "this is no state of this unit");
    return FMU_ERROR;
  }
  return FMU_OK;
}

static int fmu_restore(fmu_instance *instance, const void *stored)
{
  const int status = fmu_check_stored(instance, stored, sizeof(fmu_memory));
  if (status == FMU_OK) {
    memcpy(&instance->now, stored, sizeof(fmu_memory));
    fmu_forget(instance);
  }
  return status;
}

#if FMU_HAS_TANGENT
/* Derivatives of all derivatives and values along one direction of arguments and states. */
static int fmu_compute_direction(
    fmu_instance *instance, const double *seed_argument, const double *seed_state, double *acceleration, double *value)
{
  const fmu_memory *m = &instance->now;
  int k;
  fmu_compute_tangent(m->argument, m->state, seed_argument, seed_state, acceleration, value);
  for (k = 0; k < FMU_N_STATES - FMU_N_COORDINATES; ++k) {
    if (!(acceleration[k] - acceleration[k] == 0.0)) {
      fmu_report(instance, FMU_DISCARD, "logStatusDiscard", "a derivative is not finite at t = %.17g s", m->time);
      return FMU_DISCARD;
    }
  }
  return FMU_OK;
}

/* Add a change of a known to arguments and states. */
static int fmu_seed(fmu_instance *instance, unsigned known, double change, double *argument, double *state)
{
  if (known >= FMU_ARGUMENT && known < FMU_STATE) {
    argument[known - FMU_ARGUMENT] += change;
  } else if (known >= FMU_STATE && known < FMU_RATE) {
    state[known - FMU_STATE] += change;
  } else if (known != FMU_TIME) {
    return fmu_refuse(instance, known, "it is not a known of derivatives");
  }
  return FMU_OK;
}

/* Pick the change of an unknown. */
static int fmu_pick(
    fmu_instance *instance, unsigned unknown, const double *state, const double *acceleration, const double *value,
    double *change)
{
  if (unknown >= FMU_RATE && unknown < FMU_RATE + FMU_N_COORDINATES) {
    *change = state[FMU_N_COORDINATES + unknown - FMU_RATE];
  } else if (unknown >= FMU_RATE && unknown < FMU_VALUE) {
    *change = acceleration[unknown - FMU_RATE - FMU_N_COORDINATES];
  } else if (unknown >= FMU_VALUE && unknown < FMU_SLACK) {
    *change = value[unknown - FMU_VALUE];
  } else {
    return fmu_refuse(instance, unknown, "it is not an unknown of derivatives");
  }
  return FMU_OK;
}

/* Directional derivatives: sensitivity = (d unknown / d known) seed. */
static int fmu_find_derivative(
    fmu_instance *instance, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
    const double *seed, double *sensitivity)
{
  double argument[FMU_N_ARGUMENTS + 1] = {0.0}, state[FMU_N_STATES] = {0.0};
  double acceleration[FMU_N_STATES - FMU_N_COORDINATES], value[FMU_N_VALUES + 1];
  size_t k;
  int status = FMU_OK;
  for (k = 0; status == FMU_OK && k < n_known; ++k) {
    status = fmu_seed(instance, known[k], seed[k], argument, state);
  }
  if (status == FMU_OK) {
    status = fmu_compute_direction(instance, argument, state, acceleration, value);
  }
  for (k = 0; status == FMU_OK && k < n_unknown; ++k) {
    status = fmu_pick(instance, unknown[k], state, acceleration, value, sensitivity + k);
  }
  return status;
}
#else
static int fmu_find_derivative(
    fmu_instance *instance, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
    const double *seed, double *sensitivity)
{
  (void)unknown;
  (void)n_unknown;
  (void)known;
  (void)n_known;
  (void)seed;
  (void)sensitivity;
  fmu_report(instance, FMU_ERROR, "logStatusError", "this unit provides no derivatives");
  return FMU_ERROR;
}
#endif

#endif
