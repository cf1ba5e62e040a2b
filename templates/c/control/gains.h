#ifndef CONTROL_GAINS_H
#define CONTROL_GAINS_H
#include "memory.h"
#include "motion.h"

#if WITH_GAINS
/* Subtract the gains of a time, times deviations and sums (N_K,), from inputs (N_U,). */
static inline void gains_subtract(real time, const real *deviation, real *wanted)
{
  real s;
  const int k = control_interval(GAIN_TIME, N_GAIN, time, &s);
  const real *from = GAIN + k * N_U * N_K, *to = from + N_U * N_K;
  int u, j;
  for (u = 0; u < N_U; ++u) {
    real sum = (real)0.0;
    for (j = 0; j < N_K; ++j) {
      sum += (((real)1.0 - s) * from[u * N_K + j] + s * to[u * N_K + j]) * deviation[j];
    }
    wanted[u] -= sum;
  }
}

#endif

#if WITH_SUMS
/* Add the outputs of the deviations to their sums. */
static inline void gains_sum(real *deviation)
{
  int i, j;
  for (i = 0; i < N_Z; ++i) {
    real sum = (real)0.0;
    for (j = 0; j < N_X; ++j) {
      sum += SUM_OUTPUT[i * N_X + j] * deviation[j];
    }
    deviation[N_X + i] += sum;
  }
}
#endif

#endif
