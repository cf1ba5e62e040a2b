#ifndef DISTRIBUTE_STEP_H
#define DISTRIBUTE_STEP_H
#include "distribute.h"
#include "memory.h"
#include "motion.h"

/* Rest lengths of driven members without the actuators, and preferred tensions, at a time. */
static inline void distribution_prepare(real time, scene_control_distribution *m)
{
  real share = (real)0.0;
  int e, k;
#if WITH_OTHERS
  real input[N_IN];
  int i;
  motion_input(time, input);
#endif
  k = N_PREFERRED > 1 ? control_interval(MOTION_TIME, N_MOTION, time, &share) * N_DRIVEN : 0;
  for (e = 0; e < N_DRIVEN; ++e) {
    const real *from = PREFERRED_TENSION + k + e;
    m->preferred[e] = from[0];
    if (N_PREFERRED > 1) {
      m->preferred[e] += share * (from[N_DRIVEN] - from[0]);
    }
    m->base[e] = DRIVEN_REST[e];
#if WITH_OTHERS
    for (i = OTHER_START[e]; i < OTHER_START[e + 1]; ++i) {
      m->base[e] += input[OTHER_INPUT[i]];
    }
#endif
  }
}

/* Command that distributes tensions, within work.low and work.high; returns the status. */
static inline int control_distribute(real time, scene_control *c)
{
  distribution_sample sample;
  sample.coordinate = c->estimate;
  sample.wanted = c->wanted;
  sample.low = c->work.low;
  sample.high = c->work.high;
  sample.range_low = ACTUATOR_LEAST;
  sample.range_high = ACTUATOR_MOST;
  distribution_prepare(time, &c->distribution);
  return distribution_find(&sample, c->command, &c->distribution);
}

#endif
