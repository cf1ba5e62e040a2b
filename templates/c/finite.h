#ifndef FINITE_H
#define FINITE_H
#include "config.h"

/* Non-zero if every value is finite: zero times a finite number is zero, times any other it is NAN. Four sums, so that
 * none waits for the last. */
static inline int all_finite(const real *values, int count)
{
  real a = (real)0.0, b = (real)0.0, c = (real)0.0, d = (real)0.0;
  int k = 0;
  for (; k + 4 <= count; k += 4) {
    a += (real)0.0 * values[k];
    b += (real)0.0 * values[k + 1];
    c += (real)0.0 * values[k + 2];
    d += (real)0.0 * values[k + 3];
  }
  for (; k < count; ++k) {
    a += (real)0.0 * values[k];
  }
  return a + b + (c + d) == (real)0.0;
}

static inline void fill_nan(real *values, int count)
{
  int k;
  for (k = 0; k < count; ++k) {
    values[k] = NAN;
  }
}

#endif
