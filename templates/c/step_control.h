#ifndef STEP_CONTROL_H
#define STEP_CONTROL_H
#include "config.h"

#if WITH_FLOAT
static const double SMALLEST_STEP = 1e-37; /* [s], that numbers resolve */
#else
static const double SMALLEST_STEP = 1e-300; /* [s], that numbers resolve */
#endif

/* By how much a step whose scaled error goes with its length to the power `order` may grow or has to shrink. */
static inline double step_factor(double error, int order)
{
  return error > 0.0 ? 0.9 * pow(error, -1.0 / order) : 5.0;
}

/* The step after one of length h that was taken; it does not grow right after a rejection. */
static inline double step_after_success(double h, double error, int order, int may_grow)
{
  return h * fmin(may_grow ? 5.0 : 1.0, fmax(0.2, step_factor(error, order)));
}

/* The same for a loop that follows the error of the step before too, of `last`, which it notes: where steps are as long
 * as stability allows, the error alone makes every third of them fail. Gustafsson's proportional-integral control. */
static inline double step_by_two_errors(double h, double error, double *last, int order, int may_grow)
{
  const double now = fmax(error, 1e-10), before = *last > 0.0 ? *last : 1.0;
  *last = fmax(error, 1e-4);
  return h * fmin(may_grow ? 5.0 : 1.0, fmax(0.2, 0.9 * pow(now, -0.6 / order) * pow(before, 0.2 / order)));
}

/* The step after one of length h that was not taken; error: INFINITY where it was not finite. */
static inline double step_after_rejection(double h, double error, int order)
{
  return h * (error < INFINITY ? fmax(0.2, step_factor(error, order)) : 0.1);
}

#endif
