#ifndef EQUILIBRIUM_MEMORY_H
#define EQUILIBRIUM_MEMORY_H
#include "cholesky.h"
#include "find_equilibrium_config.h"
#include "finite.h"

#if !WITH_FLOAT
#if WITH_MEMBERS
/* Members at one configuration. */
typedef struct {
  double unit[3 * EQUILIBRIUM_MEMBERS], length[EQUILIBRIUM_MEMBERS], tension[EQUILIBRIUM_MEMBERS];
} equilibrium_members;
#endif

/* Memory of the search for an equilibrium. */
typedef struct {
  double force[N + 1], step[N + 1], trial[N + 1], trial_force[N], weight[N];
  double hessian[EQUILIBRIUM_NNZ], factor[N * N];
#if WITH_MEMBERS
  equilibrium_members here, there;
  double damping[EQUILIBRIUM_MEMBERS]; /* of each member [N/m] */
  double density[EQUILIBRIUM_MEMBERS]; /* what a stiff one lacks in tension, over its length [N/m] */
  double turn[EQUILIBRIUM_MEMBERS], need[EQUILIBRIUM_MEMBERS];
  double gap[N], stiff_factor[N * N];   /* of lengths of stiff members [m]; Cholesky factors of J J^T */
  double shift;                         /* damping of all motions [N/m] */
  double largest_force, longest;        /* [N], [m] */
  int is_started, n_stiff, stiff[N];    /* numbers of stiff members */
#endif
} equilibrium_memory;

/* Evaluates energy and forces at m->trial; returns whether they are finite. */
static inline int equilibrium_try(const equilibrium_arguments *arguments, double *energy, equilibrium_memory *m)
{
  equilibrium_energy(m->trial, arguments, energy);
  equilibrium_force(m->trial, arguments, m->trial_force);
  return all_finite(energy, 1) && all_finite(m->trial_force, N);
}

static inline void equilibrium_accept(
    double *coordinate, double energy, scene_equilibrium_report *report, equilibrium_memory *m)
{
  int k;
  for (k = 0; k < N; ++k) {
    coordinate[k] = m->trial[k];
    m->force[k] = m->trial_force[k];
  }
  report->potential_energy = energy;
  report->residual = largest_entry(m->force);
}
#endif

#endif
