#ifndef DAQP_SETTINGS_H
#define DAQP_SETTINGS_H
#include "config.h"
#include "daqp_static.h"

#include <math.h>
#include <string.h>

/* What all quadratic programs by DAQP share. */

#if WITH_FLOAT
static inline real program_root(real value) { return sqrtf(value); }
#else
static inline real program_root(real value) { return sqrt(value); }
#endif

/* Divides a row of `count` numbers by its norm, unless all are zero; returns 1 over the norm. */
static inline real program_make_unit(real *row, int count)
{
  real norm = (real)0.0;
  int j;
  for (j = 0; j < count; ++j) {
    norm += row[j] * row[j];
  }
  norm = norm > (real)0.0 ? (real)1.0 / program_root(norm) : (real)1.0;
  for (j = 0; j < count; ++j) {
    row[j] *= norm;
  }
  return norm;
}

/* Settings of DAQP: its defaults, the tolerance of bounds, the most iterations and active constraints. */
static inline DAQPSettings program_settings(real tolerance, int iterations, int most_active)
{
  DAQPSettings s;
  memset(&s, 0, sizeof s);
  s.primal_tol = tolerance;
  s.dual_tol = (real)DAQP_DEFAULT_DUAL_TOL;
  s.zero_tol = (real)DAQP_DEFAULT_ZERO_TOL;
  s.pivot_tol = (real)DAQP_DEFAULT_PIVOT_TOL;
  s.progress_tol = (real)DAQP_DEFAULT_PROG_TOL;
  s.cycle_tol = DAQP_DEFAULT_CYCLE_TOL;
  s.iter_limit = iterations + 1;
  s.most_active = most_active;
  s.fval_bound = DAQP_INF;
  s.rho_soft = (real)DAQP_DEFAULT_RHO_SOFT;
  s.sing_tol = (real)DAQP_DEFAULT_SING_TOL;
  s.refactor_tol = (real)DAQP_DEFAULT_REFACTOR_TOL;
#if WITH_FLOAT
  s.dual_tol = s.zero_tol = s.progress_tol = (real)1e-6;
  s.pivot_tol = (real)1e-4;
  s.sing_tol = s.refactor_tol = (real)1e-5;
#endif
  return s;
}

#endif
