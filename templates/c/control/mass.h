#ifndef CONTROL_MASS_H
#define CONTROL_MASS_H
#include "config.h"

#if WITH_ESTIMATOR
#if WITH_DISTURBANCE
/* Solve M x = b in place, M symmetric and stored row by row from the first entry of each row to the diagonal (its
 * envelope), which becomes the factors L and D of M = L D L^T. Returns whether M is positive definite. */
static inline int mass_solve(real *mass, real *x)
{
  int i, j, k;
  for (i = 0; i < N_Q; ++i) {
    const int first = MASS_FIRST[i];
    real *own = mass + (MASS_ROW[i] - first);
    for (j = first; j < i; ++j) {
      const real *other = mass + (MASS_ROW[j] - MASS_FIRST[j]);
      for (k = first > MASS_FIRST[j] ? first : MASS_FIRST[j]; k < j; ++k) {
        own[j] -= own[k] * other[k];
      }
    }
    /* d_i = m_ii - sum_k l_ik^2 d_k, and x = L^-1 b on the way */
    for (k = first; k < i; ++k) {
      const real whole = own[k];
      own[k] /= mass[MASS_ROW[k] + k - MASS_FIRST[k]];
      own[i] -= whole * own[k];
      x[i] -= own[k] * x[k];
    }
    if (!(own[i] > (real)0.0)) {
      return 0;
    }
  }
  /* x = L^-T D^-1 x */
  for (i = N_Q - 1; i >= 0; --i) {
    const int first = MASS_FIRST[i];
    const real *own = mass + (MASS_ROW[i] - first);
    x[i] /= own[i];
  }
  for (i = N_Q - 1; i >= 0; --i) {
    const int first = MASS_FIRST[i];
    const real *own = mass + (MASS_ROW[i] - first);
    for (k = first; k < i; ++k) {
      x[k] -= own[k] * x[i];
    }
  }
  return 1;
}
#endif
#endif

#endif
