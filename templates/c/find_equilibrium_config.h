/* Sample of what the generator writes in place of this file for the solver: N springs in a row, fixed at the left,
 * each of length 1 and stiffness 1, and a force on every node. */
#ifndef FIND_EQUILIBRIUM_CONFIG_H
#define FIND_EQUILIBRIUM_CONFIG_H
#include "config.h"

enum {
  SCENE_NOT_CONVERGED = 8,
  SCENE_UNSTABLE = 9,
  SCENE_BRANCH_LOST = 10,
  EQUILIBRIUM_NNZ = N * N, /* entries of the Hessian */
  EQUILIBRIUM_MEMBERS = N,
  EQUILIBRIUM_VARIED = N   /* entries of the argument that a path varies */
};

typedef struct {
  int status, iterations, shifted;
  double contraction, residual, smallest_pivot, potential_energy;
} scene_equilibrium_report;

/* Arguments besides the coordinates; the one that a path varies is `varied`. */
typedef struct {
  const double *varied;
} equilibrium_arguments;

#if !WITH_FLOAT
/* Row of each entry of the Hessian, and where its columns start. */
static inline const int *equilibrium_row(void)
{
  static int row[N * N];
  int k;
  for (k = 0; k < N * N; ++k) {
    row[k] = k % N;
  }
  return row;
}

static inline const int *equilibrium_column_start(void)
{
  static int start[N + 1];
  int k;
  for (k = 0; k <= N; ++k) {
    start[k] = k * N;
  }
  return start;
}

/* Coordinates of the ends of each member, three of either end, N where an end is fixed. */
static inline const short *equilibrium_ends(void)
{
  static short ends[6 * N];
  int k;
  for (k = 0; k < 6 * N; ++k) {
    ends[k] = (short)(k % 6 == 0 ? k / 6 : k % 6 == 3 && k > 6 ? k / 6 - 1 : N);
  }
  return ends;
}

/* What fixed ends add to the vector from the second end of a member to the first. */
static inline void equilibrium_fixed_part(const equilibrium_arguments *arguments, int member, double *vector)
{
  (void)arguments;
  (void)member;
  vector[0] = vector[1] = vector[2] = 0.0;
}

static inline double sample_stretch(const double *coordinate, int k)
{
  return coordinate[k] - (k > 0 ? coordinate[k - 1] : 0.0) - 1.0;
}

static inline void equilibrium_energy(const double *coordinate, const equilibrium_arguments *arguments, double *energy)
{
  int k;
  *energy = 0.0;
  for (k = 0; k < N; ++k) {
    const double stretch = sample_stretch(coordinate, k);
    *energy += 0.5 * stretch * stretch - arguments->varied[k] * coordinate[k];
  }
}

static inline void equilibrium_force(const double *coordinate, const equilibrium_arguments *arguments, double *force)
{
  int k;
  for (k = 0; k < N; ++k) {
    force[k] = arguments->varied[k] - sample_stretch(coordinate, k)
        + (k + 1 < N ? sample_stretch(coordinate, k + 1) : 0.0);
  }
}

static inline void equilibrium_tension(
    const double *coordinate, const equilibrium_arguments *arguments, double *tension)
{
  int k;
  (void)arguments;
  for (k = 0; k < N; ++k) {
    tension[k] = sample_stretch(coordinate, k);
  }
}

static inline void equilibrium_hessian(
    const double *coordinate, const equilibrium_arguments *arguments, double *hessian)
{
  int i, k;
  (void)coordinate;
  (void)arguments;
  for (k = 0; k < N; ++k) {
    for (i = 0; i < N; ++i) {
      hessian[k * N + i] = i == k ? (k + 1 < N ? 2.0 : 1.0) : i == k + 1 || i == k - 1 ? -1.0 : 0.0;
    }
  }
}
#endif

#endif
