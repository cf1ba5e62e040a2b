#ifndef FIND_EQUILIBRIUM_H
#define FIND_EQUILIBRIUM_H
#include "cholesky.h"
#include "find_equilibrium_config.h"
#include "finite.h"

#if !WITH_FLOAT
/* Memory of Newton's method. */
typedef struct {
  double force[N], step[N], trial[N], trial_force[N], weight[N];
  double hessian[EQUILIBRIUM_NNZ], factor[N * N];
} equilibrium_memory;

static inline void equilibrium_clear(scene_equilibrium_report *report)
{
  report->iterations = report->shifted = 0;
  report->contraction = 0.0;
  report->residual = report->smallest_pivot = report->potential_energy = NAN;
}

/* Moves coordinate along the step as far as lets the energy fall; returns 0 where no part of the step does. */
static inline int equilibrium_advance(
    double *coordinate, const equilibrium_arguments *arguments, scene_equilibrium_report *report, equilibrium_memory *m)
{
  const double before = report->potential_energy;
  double slope = 0.0, part = 2.0;
  int k, halving;
  for (k = 0; k < N; ++k) {
    slope -= m->force[k] * m->step[k];
  }
  for (halving = 0; halving < 50; ++halving) {
    double energy, residual, noise;
    part *= 0.5;
    for (k = 0; k < N; ++k) {
      m->trial[k] = coordinate[k] + part * m->step[k];
    }
    equilibrium_energy(m->trial, arguments, &energy);
    equilibrium_force(m->trial, arguments, m->trial_force);
    if (!all_finite(&energy, 1) || !all_finite(m->trial_force, N)) {
      continue;
    }
    residual = largest_entry(m->trial_force);
    /* Where the fall is less than the rounding of the energy, the residual has to fall. */
    noise = 1e-14 * (fabs(before) + fabs(energy));
    if (energy - before <= 1e-4 * part * slope ||
        (-part * slope <= 100.0 * noise && energy - before <= noise && residual < report->residual)) {
      for (k = 0; k < N; ++k) {
        coordinate[k] = m->trial[k];
        m->force[k] = m->trial_force[k];
      }
      report->potential_energy = energy;
      report->residual = residual;
      return 1;
    }
  }
  return 0;
}

/* Factors of the Hessian, shifted until it is positive definite; returns whether there are any. */
static inline int equilibrium_factor_shifted(equilibrium_memory *m)
{
  const int *row = equilibrium_row(), *start = equilibrium_column_start();
  double shift = 1e-3, pivot;
  int is_definite = 0;
  while (!is_definite && shift < 1e9) {
    is_definite = cholesky_factor(m->hessian, row, start, shift, m->weight, m->factor, &pivot);
    shift *= 4.0;
  }
  return is_definite;
}

/* One step of Newton's method with the factors; *last is the length of the step before. */
static inline int equilibrium_take_step(
    double *coordinate, const equilibrium_arguments *arguments, double tolerance, double *last,
    scene_equilibrium_report *report, equilibrium_memory *m)
{
  double size = 0.0;
  int k;
  cholesky_solve(m->factor, m->force, m->step);
  for (k = 0; k < N; ++k) {
    size += m->weight[k] * m->step[k] * m->step[k];
  }
  size = sqrt(size);
  /* Near the tolerance steps are rounding and need not contract. */
  if (*last > 0.0 && report->residual > 1e3 * tolerance && size > report->contraction * *last) {
    report->contraction = size / *last;
  }
  *last = size;
  return equilibrium_advance(coordinate, arguments, report, m);
}

/* Newton's method from coordinate, which is advanced in place. */
static inline int equilibrium_newton(
    double *coordinate, const equilibrium_arguments *arguments, double tolerance, int most_iterations,
    scene_equilibrium_report *report, equilibrium_memory *m)
{
  const int *row = equilibrium_row(), *start = equilibrium_column_start();
  double last = 0.0;
  equilibrium_clear(report);
  equilibrium_energy(coordinate, arguments, &report->potential_energy);
  equilibrium_force(coordinate, arguments, m->force);
  report->residual = largest_entry(m->force);
  if (!all_finite(&report->potential_energy, 1) || !all_finite(m->force, N)) {
    return SCENE_NON_FINITE_RESULT;
  }
  for (;;) {
    int is_definite;
    equilibrium_hessian(coordinate, arguments, m->hessian);
    if (!all_finite(m->hessian, EQUILIBRIUM_NNZ)) {
      return SCENE_NON_FINITE_RESULT;
    }
    cholesky_weight(m->hessian, row, start, m->weight);
    is_definite =
        cholesky_factor(m->hessian, row, start, 0.0, m->weight, m->factor, &report->smallest_pivot);
    if (report->residual <= tolerance) {
      if (!is_definite) {
        return SCENE_UNSTABLE;
      }
      return SCENE_OK;
    }
    if (report->iterations >= most_iterations) {
      return SCENE_NOT_CONVERGED;
    }
    if (!is_definite) {
      ++report->shifted;
      if (!equilibrium_factor_shifted(m)) {
        return SCENE_NOT_CONVERGED;
      }
    }
    if (!equilibrium_take_step(coordinate, arguments, tolerance, &last, report, m)) {
      return SCENE_NOT_CONVERGED;
    }
    ++report->iterations;
  }
}

/* Checks what the caller gives, clears the report and looks for the equilibrium; `is_finite`: whether the arguments
 * besides the coordinates are. */
static inline int equilibrium_find(
    double *coordinate, const equilibrium_arguments *arguments, int is_finite, double tolerance, int most_iterations,
    scene_equilibrium_report *report, equilibrium_memory *m)
{
  equilibrium_clear(report);
  if (!is_finite || !all_finite(coordinate, N) || !all_finite(&tolerance, 1)) {
    report->status = SCENE_NON_FINITE_INPUT;
  } else if (!(tolerance > 0.0) || most_iterations < 0) {
    report->status = SCENE_INVALID_ARGUMENT;
  } else {
    report->status = equilibrium_newton(coordinate, arguments, tolerance, most_iterations, report, m);
  }
  return report->status;
}
#endif

#endif
