#ifndef FIND_EQUILIBRIUM_H
#define FIND_EQUILIBRIUM_H
#include "equilibrium_memory.h"
#include "member_steps.h"

#if !WITH_FLOAT
static inline void equilibrium_clear(scene_equilibrium_report *report)
{
  report->iterations = report->shifted = 0;
  report->contraction = 0.0;
  report->residual = report->smallest_pivot = report->potential_energy = NAN;
}

/* Moves coordinate along the step as far as lets the energy fall, with at most so many halvings, to where the residual
 * is below `limit`; returns 0 where no part of the step does. */
static inline int equilibrium_advance(
    double *coordinate, const equilibrium_arguments *arguments, int halvings, double limit,
    scene_equilibrium_report *report, equilibrium_memory *m)
{
  const double before = report->potential_energy;
  double slope = 0.0, part = 1.0;
  int k;
  for (k = 0; k < N; ++k) {
    slope -= m->force[k] * m->step[k];
  }
  for (; halvings >= 0; --halvings, part *= 0.5) {
    double energy, residual, noise;
    for (k = 0; k < N; ++k) {
      m->trial[k] = coordinate[k] + part * m->step[k];
    }
    if (!equilibrium_try(arguments, &energy, m)) {
      continue;
    }
    residual = largest_entry(m->trial_force);
    /* Where the fall is less than the rounding of the energy, the residual has to fall. */
    noise = 1e-14 * (fabs(before) + fabs(energy));
    if (residual < limit && (energy - before <= 1e-4 * part * slope ||
        (-part * slope <= 100.0 * noise && energy - before <= noise && residual < report->residual))) {
      equilibrium_accept(coordinate, energy, report, m);
      return 1;
    }
  }
  return 0;
}

#if WITH_MEMBERS
/* One step: of Newton's method where that halves the residual, else one that damps members. */
static inline int equilibrium_take_step(
    double *coordinate, const equilibrium_arguments *arguments, int is_definite, scene_equilibrium_report *report,
    equilibrium_memory *m)
{
  if (is_definite) {
    cholesky_solve(N, m->factor, m->force, m->step);
    if (equilibrium_advance(coordinate, arguments, 0, 0.5 * report->residual, report, m)) {
      return 1;
    }
  }
  return member_take_step(coordinate, arguments, report, m);
}
#else
/* One step of Newton's method, with the Hessian shifted until it is positive definite. */
static inline int equilibrium_take_step(
    double *coordinate, const equilibrium_arguments *arguments, int is_definite, scene_equilibrium_report *report,
    equilibrium_memory *m)
{
  const int *row = equilibrium_row(), *start = equilibrium_column_start();
  double shift, pivot;
  report->shifted += !is_definite;
  for (shift = 1e-3; !is_definite && shift < 1e9; shift *= 4.0) {
    cholesky_fill(m->hessian, row, start, shift, m->weight, m->factor);
    is_definite = cholesky_factor(N, m->factor, &pivot);
  }
  cholesky_solve(N, m->factor, m->force, m->step);
  return is_definite && equilibrium_advance(coordinate, arguments, 50, INFINITY, report, m);
}
#endif

/* Notes by how much a step was shorter than the one before, of length *last. */
static inline void equilibrium_note_step(double *last, scene_equilibrium_report *report, const equilibrium_memory *m)
{
  double size = 0.0;
  int k;
  for (k = 0; k < N; ++k) {
    size += m->weight[k] * m->step[k] * m->step[k];
  }
  size = sqrt(size);
  if (*last > 0.0 && size > report->contraction * *last) {
    report->contraction = size / *last;
  }
  *last = size;
}

/* Newton's method from coordinate, which is advanced in place. */
static inline int equilibrium_newton(
    double *coordinate, const equilibrium_arguments *arguments, double tolerance, int most_iterations,
    scene_equilibrium_report *report, equilibrium_memory *m)
{
  const int *row = equilibrium_row(), *start = equilibrium_column_start();
  double last = 0.0, residual;
  equilibrium_clear(report);
#if WITH_MEMBERS
  m->is_started = 0;
#endif
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
    cholesky_fill(m->hessian, row, start, 0.0, m->weight, m->factor);
    is_definite = cholesky_factor(N, m->factor, &report->smallest_pivot);
    if (report->residual <= tolerance) {
      if (!is_definite) {
        return SCENE_UNSTABLE;
      }
      return SCENE_OK;
    }
    if (report->iterations >= most_iterations) {
      return SCENE_NOT_CONVERGED;
    }
    residual = report->residual;
    if (!equilibrium_take_step(coordinate, arguments, is_definite, report, m)) {
      return SCENE_NOT_CONVERGED;
    }
    /* Near the tolerance steps are rounding and need not contract. */
    if (residual > 1e3 * tolerance) {
      equilibrium_note_step(&last, report, m);
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
