#ifndef FOLLOW_EQUILIBRIA_H
#define FOLLOW_EQUILIBRIA_H
#include "find_equilibrium.h"

#if !WITH_FLOAT
/* Memory of a path: that of Newton's method, and a part of a step. */
typedef struct {
  equilibrium_memory newton;
  double trial[N], between[EQUILIBRIUM_VARIED];
} equilibrium_path_memory;

/* Moves place from its equilibrium under `before` to the one under arguments->varied on the same branch, in parts. */
static inline int equilibrium_step(
    double *place, const double *before, const equilibrium_arguments *arguments, double tolerance, int most_iterations,
    scene_equilibrium_report *report, equilibrium_path_memory *m)
{
  equilibrium_arguments part_of = *arguments;
  double done = 0.0, part = 1.0;
  int iterations = 0, k;
  part_of.varied = m->between;
  while (done < 1.0) {
    const double goal = done + part < 1.0 ? done + part : 1.0;
    int status;
    for (k = 0; k < N; ++k) {
      m->trial[k] = place[k];
    }
    for (k = 0; k < EQUILIBRIUM_VARIED; ++k) {
      m->between[k] = goal < 1.0 ? before[k] + goal * (arguments->varied[k] - before[k]) : arguments->varied[k];
    }
    /* Accept a part in which Newton's method contracts; halve it otherwise. */
    status = equilibrium_newton(m->trial, &part_of, tolerance, most_iterations, report, &m->newton);
    iterations += report->iterations;
    report->iterations = iterations;
    if (status == SCENE_OK && report->shifted == 0 &&
        (report->contraction <= 0.5 || (part <= 0.001 && report->contraction < 1.0))) {
      for (k = 0; k < N; ++k) {
        place[k] = m->trial[k];
      }
      done = goal;
      part *= 2.0;
    } else if (part > 0.001) {
      part *= 0.5;
    } else {
      return status == SCENE_OK ? (int)SCENE_BRANCH_LOST : status;
    }
  }
  return SCENE_OK;
}

/* Equilibria under n_path values of arguments->varied, one after the other, each from the one before. */
static inline int equilibrium_follow(
    const double *start, long long n_path, const equilibrium_arguments *arguments, int is_finite, double tolerance,
    int most_iterations, double *coordinate, scene_equilibrium_report *report, long long *n_found,
    equilibrium_path_memory *m)
{
  const double *from = start;
  long long i;
  int k, status = SCENE_OK;
  for (i = 0; i < n_path; ++i) {
    double *place = coordinate + i * N;
    equilibrium_arguments own = *arguments;
    own.varied = arguments->varied + i * EQUILIBRIUM_VARIED;
    if (status != SCENE_OK) {
      fill_nan(place, N);
      continue;
    }
    for (k = 0; k < N; ++k) {
      place[k] = from[k];
    }
    if (i == 0) {
      is_finite = is_finite && all_finite(own.varied, EQUILIBRIUM_VARIED);
      status = equilibrium_find(place, &own, is_finite, tolerance, most_iterations, report, &m->newton);
    } else if (!all_finite(own.varied, EQUILIBRIUM_VARIED)) {
      equilibrium_clear(report + i);
      status = SCENE_NON_FINITE_INPUT;
    } else {
      const double *before = own.varied - EQUILIBRIUM_VARIED;
      status = equilibrium_step(place, before, &own, tolerance, most_iterations, report + i, m);
    }
    report[i].status = status;
    *n_found += status == SCENE_OK;
    if (status != SCENE_OK) {
      fill_nan(place, N);
    }
    from = place;
  }
  return status;
}
#endif

#endif
