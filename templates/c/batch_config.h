/* Sample of what the generator writes for batches in place of this file: the structure's functions over the lanes. */
#ifndef BATCH_CONFIG_H
#define BATCH_CONFIG_H
#include "batch.h"

/* Accelerations of all lanes. */
static inline void motion_slope_lanes(
    const motion_batch *m, const real *coordinate, const real *velocity, real *result)
{
  motion_each_lane(motion_slope, m, coordinate, velocity, result);
}

/* Derivatives (v, a) of the states (q, v). */
static inline void motion_rate_lanes(const motion_batch *m, const real *state, real *rate)
{
  int k;
  for (k = 0; k < N * WIDTH; ++k) {
    rate[k] = state[N * WIDTH + k];
  }
  motion_slope_lanes(m, state, state + N * WIDTH, rate + N * WIDTH);
}

/* Bring all lanes back onto the constraints between coordinates; these have none. */
static inline void motion_project_lanes(const motion_batch *m, real *coordinate, real *velocity, real *spare)
{
  (void)m;
  (void)coordinate;
  (void)velocity;
  (void)spare;
}

#endif
