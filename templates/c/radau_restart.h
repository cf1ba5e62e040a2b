#ifndef RADAU_RESTART_H
#define RADAU_RESTART_H
#include "radau_smooth.h"
#if !WITH_FLOAT

/* Go on behind an event, whose forces may have a kink or jump: smooth values anew, from nothing that was before. */
static inline int radau_restart(radau_work *run, double extrapolated, double step, const double *state)
{
  const double *q = state, *v = state + N;
  int b;
  radau_members(run, q, v, run->direction, run->gap, run->rate);
  for (b = 0; b < N_TENSIONS; ++b) {
    const double kappa = run->compliance[b];
    const int resolved = radau_resolved * kappa > run->mobility[b] * step * step;
    run->stage_tension[b] = resolved ? (run->gap[b] + run->lag[b] * run->rate[b]) / kappa
                                     : run->tension[b] + extrapolated * run->slope[b];
    run->slope[b] = 0.0;
    run->bend[b] = 0.0;
  }
  run->kept[RADAU_KEPT_STEP] = 0.0;
  run->kept[RADAU_KEPT_HAS_JERK] = 0.0;
#if WITH_PROFILE
  profile_set_stage(0.0, run->with->profile);
#endif
  return radau_smooth(run, INFINITY, q, v, run->stage_tension, run->slope, run->bend) && radau_find_slopes(run, q)
      && radau_smooth(run, step, q, v, run->stage_tension, run->slope, run->bend);
}

#endif
#endif
