/* Sample of what the generator writes for an explicit method: here Heun's method of order 2 beside Euler's. */
#ifndef TABLEAU_H
#define TABLEAU_H
#include "finite.h"
#include "sample.h"

#define METHOD_HAS_ERROR 1                 /* steps have an error estimate; else their length is fixed */
#define METHOD_HAS_DENSE 1                 /* samples between steps by a polynomial of its own */
#define METHOD_HAS_MEMORY 0                /* trials have a memory of their own, method_memory */
#define METHOD_KEEPS_ENERGY (!WITH_FLOAT)  /* steps can keep the energy */
#define METHOD_HAS_LATE_END 1              /* the derivative at the end is computed for steps that are taken */
#define METHOD_ENDS_WATCHED (!WITH_FLOAT)  /* and for those on which events are looked for */

enum {
  METHOD_STAGES = 2,
  METHOD_RATES = 3,       /* derivatives that are kept */
  METHOD_ERROR_ORDER = 2, /* power of the step with which the error estimate goes */
  METHOD_DENSE = 3,       /* terms of dense output */
  METHOD_DENSE_ROWS = 0,  /* evaluations that it takes */
  METHOD_EVALUATIONS = 1  /* that a trial takes */
};

#if WITH_ADJOINT
/* Row i - 1: how the i-th rate depends on those before it, and at which part of the step. */
static const real method_row[2][3] = {{1, 0, 0}, {(real)0.5, (real)0.5, 0}};
static const double method_node[2] = {1.0, 1.0};
/* Terms of dense output behind the first three, which are the same for all methods. */
enum { METHOD_TERMS = 0 };
static const real method_term[1][3] = {{0, 0, 0}};

#endif
/* Try a step: rates[0] is the derivative at `state`; fills rates[1], the change of the state and `trial`, and returns
 * the scaled error. `lost` is what rounding has taken from the state so far (Kahan 1965). */
static inline double method_try(
    real h, double rtol, double atol, const real *state, const motion_arguments *with, const real *lost,
    real *TENSEGRITY_RESTRICT rates, real *TENSEGRITY_RESTRICT change, real *TENSEGRITY_RESTRICT trial)
{
  double worst = 0.0;
  int k;
  for (k = 0; k < N_STATES; ++k) {
    trial[k] = state[k] + (h * rates[k] + lost[k]);
  }
#if WITH_PROFILE
  profile_set_stage((double)h, with->profile);
#endif
  motion_rate(trial, with, rates + N_STATES);
  for (k = 0; k < N_STATES; ++k) {
    change[k] = h * ((real)0.5 * rates[k] + (real)0.5 * rates[N_STATES + k]) + lost[k];
    trial[k] = state[k] + change[k];
    worst = fmax(worst, fabs((double)(h * (rates[N_STATES + k] - rates[k]))) / (atol + rtol * fabs((double)trial[k])));
  }
  return all_finite(trial, N_STATES) ? worst : INFINITY;
}

/* Make ready for dense output in the step from `old` to `trial`; fills dense. */
static inline void method_prepare(
    real h, const real *old, const motion_arguments *with, const real *trial, real *spare,
    real *TENSEGRITY_RESTRICT rates, real *TENSEGRITY_RESTRICT dense)
{
  int k;
  (void)with;
  (void)spare;
  for (k = 0; k < N_STATES; ++k) {
    const real rise = trial[k] - old[k];
    dense[k] = rise;
    dense[N_STATES + k] = h * rates[k] - rise;
    dense[2 * N_STATES + k] = (real)2.0 * rise - h * (rates[2 * N_STATES + k] + rates[k]);
  }
}

#endif
