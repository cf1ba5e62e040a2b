#ifndef FINITE_H
#define FINITE_H
#include "config.h"

#if WITH_NATIVE
/* Non-zero if every value is finite: x - x is zero then, else NAN. Compilers for wide registers make vectors of it. */
static inline int all_finite(const real *values, int count)
{
  long long is_any_infinite = 0;
  int k;
  for (k = 0; k < count; ++k) {
    is_any_infinite |= values[k] - values[k] != (real)0.0;
  }
  return !is_any_infinite;
}
#else
/* Non-zero if every value is finite: x - x is zero then, else NAN. Four sums, so that none waits for the last. */
static inline int all_finite(const real *values, int count)
{
  real a = (real)0.0, b = (real)0.0, c = (real)0.0, d = (real)0.0;
  int k = 0;
  for (; k + 4 <= count; k += 4) {
    a += values[k] - values[k];
    b += values[k + 1] - values[k + 1];
    c += values[k + 2] - values[k + 2];
    d += values[k + 3] - values[k + 3];
  }
  for (; k < count; ++k) {
    a += values[k] - values[k];
  }
  return a + b + (c + d) == (real)0.0;
}
#endif

static inline void fill_nan(real *values, int count)
{
  int k;
  for (k = 0; k < count; ++k) {
    values[k] = NAN;
  }
}

#endif
