#ifndef CONTROL_CLOSED_LOOP_H
#define CONTROL_CLOSED_LOOP_H
#include "closed_loop_config.h"
#include "loop_memory.h"

/* Simulation of a closed loop: the controller at every sample, the plant integrated between samples. */

/* Move the plant over a time with the arguments as they are; returns whether that succeeded. */
static inline int closed_loop_integrate(const plant_functions *f, double span, real *state, closed_loop *d)
{
  double time = 0.0;
  d->plant_status = plant_integrate(f, span, &time, state, &d->with, d->work);
  if (d->plant_status == PLANT_OK && time < span) {
    d->plant_status = PLANT_STEP_TOO_SMALL;
  }
  return d->plant_status == PLANT_OK;
}

/* Move the plant from one time to another, with constant inputs; loads may change in between. */
static inline int closed_loop_move(const plant_functions *f, double from, double to, real *state, closed_loop *d)
{
  long long k = 0;
  while (k < d->n_changes && d->change_time[k] <= from) {
    ++k;
  }
  for (;; ++k) {
    const int is_last = !(k < d->n_changes && d->change_time[k] < to);
    const double end = is_last ? to : d->change_time[k];
#if WITH_LOADS
    memcpy(d->with.node_load, d->load + k * LOAD_SIZE, LOAD_SIZE * sizeof(real));
#endif
    if (!closed_loop_integrate(f, end - from, state, d)) {
      return 0;
    }
    if (is_last) {
      return 1;
    }
    from = end;
  }
}

/* Set the inputs of the actuators where commands arrive in a sample, as far as their rates permit. */
static inline void closed_loop_apply_arrived(long long sample, long long arrival, closed_loop *d)
{
  int u;
  for (u = 0; u < N_U; ++u) {
    if (d->arrival[u] == arrival) {
      const real command = d->command[(d->n_before + sample - d->delay_samples[u]) * N_U + u];
      const real high = d->applied[u] + d->most_change[u], low = d->applied[u] - d->most_change[u];
      d->applied[u] = command > high ? high : command < low ? low : command;
    }
    d->with.input[ACTUATOR_PLACE[u]] = d->applied[u];
  }
}

/* Move the plant from a sample to the next one. */
static inline int closed_loop_sample(const plant_functions *f, long long sample, real *state, closed_loop *d)
{
  const double time = (double)sample * (double)CONTROL_SAMPLE;
  long long k;
  memcpy(d->with.input, d->controller->input, N_IN * sizeof(real)); /* of the motion; those of actuators follow */
  for (k = 0; k < d->n_arrivals; ++k) {
    const double end = k + 1 < d->n_arrivals ? d->arrival_time[k + 1] : (double)CONTROL_SAMPLE;
    closed_loop_apply_arrived(sample, k, d);
    if (!closed_loop_move(f, time + d->arrival_time[k], time + end, state, d)) {
      return 0;
    }
  }
  return 1;
}

/* One step of the controller; returns whether there is an estimate to go on with. */
static inline int closed_loop_step(const plant_functions *f, long long k, closed_loop *d)
{
  const real *state = d->state + k * N_PLANT;
  real rest_length[N_U];
#if WITH_ESTIMATOR
  real measured[N_Y];
  int i;
  d->is_lost = plant_measure(f, state, &d->with, d->values, measured) != PLANT_OK;
  for (i = 0; i < N_Y; ++i) {
    measured[i] += d->noise[k * N_Y + i];
  }
  d->status[k] = scene_control_next(d->controller, measured, rest_length);
#else
  (void)f;
  d->status[k] = scene_control_next_state(d->controller, state, rest_length);
#endif
  memcpy(d->command + (d->n_before + k) * N_U, d->controller->command, N_U * sizeof(real));
  d->is_lost |= d->status[k] == SCENE_CONTROL_ESTIMATE_LOST || d->status[k] == SCENE_CONTROL_NON_FINITE_INPUT;
  return !d->is_lost;
}

/* Store what the controller did in a sample, and the tensions at its end; returns whether these are finite. */
static inline int closed_loop_store(const plant_functions *f, long long k, closed_loop *d)
{
  memcpy(d->input + k * N_IN, d->with.input, N_IN * sizeof(real));
#if WITH_ESTIMATOR
  memcpy(d->estimate + k * N_X, d->controller->estimate, N_X * sizeof(real));
  memcpy(d->disturbance + k * N_Q, d->controller->disturbance, N_Q * sizeof(real));
#endif
#if WITH_DISTRIBUTION
  memcpy(d->yields + k * N_DRIVEN, d->controller->distribution.yields, N_DRIVEN * sizeof(int));
#endif
  d->plant_status = plant_tension(f, d->state + (k + 1) * N_PLANT, &d->with, d->tension + (k + 1) * N_TENSIONS);
  return d->plant_status == PLANT_OK;
}

/* Simulate a loop up to its end, or to where the plant stops or the estimate is lost. */
static inline void closed_loop_run(const plant_functions *f, closed_loop *d)
{
  long long k;
  d->n_done = 0;
  d->is_lost = 0;
  memcpy(d->state, d->start, N_PLANT * sizeof(real));
  scene_control_init(d->controller, NULL);
  memcpy(d->with.input, d->controller->input, N_IN * sizeof(real));
  d->plant_status = plant_tension(f, d->state, &d->with, d->tension);
  for (k = 0; k < d->count && d->plant_status == PLANT_OK; ++k) {
    real *next = d->state + (k + 1) * N_PLANT;
    memcpy(next, d->state + k * N_PLANT, N_PLANT * sizeof(real));
    if (!closed_loop_step(f, k, d) || !closed_loop_sample(f, k, next, d)
        || !closed_loop_store(f, k, d)) {
      return;
    }
    d->n_done = k + 1;
  }
}

#endif
