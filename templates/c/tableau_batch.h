/* Sample of what the generator writes for an explicit method over the lanes: that of tableau.h. */
#ifndef TABLEAU_BATCH_H
#define TABLEAU_BATCH_H
#include "batch_config.h"
#include "tableau.h"

/* Try a step of its own length in every lane, as method_try does; error receives the scaled error of each. */
static inline void method_try_lanes(
    const motion_batch *m, const real *TENSEGRITY_RESTRICT h, double rtol, double atol,
    const real *TENSEGRITY_RESTRICT state, const real *TENSEGRITY_RESTRICT lost, real *TENSEGRITY_RESTRICT rates,
    real *TENSEGRITY_RESTRICT change, real *TENSEGRITY_RESTRICT trial, double *TENSEGRITY_RESTRICT error)
{
  int i;
  for (i = 0; i < N_STATES * WIDTH; ++i) {
    trial[i] = state[i] + (h[i % WIDTH] * rates[i] + lost[i]);
    error[i % WIDTH] = 0.0;
  }
  motion_rate_lanes(m, trial, rates + N_STATES * WIDTH);
  for (i = 0; i < N_STATES * WIDTH; ++i) {
    const real length = h[i % WIDTH], rise = rates[N_STATES * WIDTH + i] - rates[i];
    change[i] = length * ((real)0.5 * rates[i] + (real)0.5 * rates[N_STATES * WIDTH + i]) + lost[i];
    trial[i] = state[i] + change[i];
    error[i % WIDTH] = fmax(
        trial[i] - trial[i] == (real)0.0 ? error[i % WIDTH] : INFINITY,
        fabs((double)(length * rise)) / (atol + rtol * fabs((double)trial[i])));
  }
}

/* Make all lanes ready for dense output, as method_prepare does. */
static inline void method_prepare_lanes(
    const motion_batch *m, const real *TENSEGRITY_RESTRICT h, const real *TENSEGRITY_RESTRICT old,
    const real *TENSEGRITY_RESTRICT trial, real *TENSEGRITY_RESTRICT spare, real *TENSEGRITY_RESTRICT rates,
    real *TENSEGRITY_RESTRICT dense)
{
  int i;
  (void)m;
  (void)spare;
  for (i = 0; i < N_STATES * WIDTH; ++i) {
    const real rise = trial[i] - old[i], length = h[i % WIDTH];
    dense[i] = rise;
    dense[N_STATES * WIDTH + i] = length * rates[i] - rise;
    dense[2 * N_STATES * WIDTH + i] = (real)2.0 * rise - length * (rates[2 * N_STATES * WIDTH + i] + rates[i]);
  }
}

#endif
