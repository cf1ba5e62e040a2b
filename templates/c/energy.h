#ifndef ENERGY_H
#define ENERGY_H
#include "config.h"
#if WITH_ENERGY

/* Keeps the total energy of conservative motions: velocities are corrected after a step. */

/* Memory of motion_keep_energy: non-zeros of H; velocities without rigid motion, and H times these. */
typedef struct {
  double mass[N_MASSES], internal[N], momentum[N], spare[2 * N];
} energy_memory;

/* y = H x; mass: the non-zeros of H. */
static inline void motion_multiply_mass(const double *mass, const double *x, double *y)
{
  int k;
#if WITH_DIAGONAL_MASS
  for (k = 0; k < N; ++k) {
    y[k] = mass[k] * x[k];
  }
#else
  int column;
  for (column = 0; column < N; ++column) {
    double sum = 0.0;
    for (k = scene_mass_matrix_column_start[column]; k < scene_mass_matrix_column_start[column + 1]; ++k) {
      sum += mass[k] * x[scene_mass_matrix_row[k]];
    }
    y[column] = sum;
  }
#endif
}

#if WITH_RIGID_MOTION
/* Velocity of each coordinate in rigid motion k: along an axis, or about one through `middle`. */
static inline void motion_rigid_velocity(int k, const double *q, const double *middle, double *x)
{
  int c;
  for (c = 0; c < N; c += AXES) {
#if WITH_AXES_3
    const double r[3] = {q[c] - middle[0], q[c + 1] - middle[1], q[c + 2] - middle[2]};
    x[c] = k == 0 ? 1.0 : k == 4 ? r[2] : k == 5 ? -r[1] : 0.0;
    x[c + 1] = k == 1 ? 1.0 : k == 3 ? -r[2] : k == 5 ? r[0] : 0.0;
    x[c + 2] = k == 2 ? 1.0 : k == 3 ? r[1] : k == 4 ? -r[0] : 0.0;
#else
#if WITH_AXES_2
    x[c] = k == 0 ? 1.0 : k == 2 ? middle[1] - q[c + 1] : 0.0;
    x[c + 1] = k == 1 ? 1.0 : k == 2 ? q[c] - middle[0] : 0.0;
#else
    (void)q;
    (void)middle;
    x[c] = k == 0 ? 1.0 : 0.0;
#endif
#endif
  }
}

/* Take out of v (n,) the rigid motion that has its momentum and angular momentum, in the metric of H; spare (2, n). */
static inline void motion_remove_rigid(const double *mass, const double *q, double *v, double *spare)
{
  double matrix[N_RIGID][N_RIGID], right_side[N_RIGID], middle[AXES] = {0.0}, *x = spare, *y = spare + N;
  const int n_nodes = N / AXES;
  int i, j, k;
  for (k = 0; k < N; ++k) {
    middle[k % AXES] += q[k] / n_nodes;
  }
  for (i = 0; i < N_RIGID; ++i) {
    motion_rigid_velocity(i, q, middle, x);
    motion_multiply_mass(mass, x, y);
    right_side[i] = 0.0;
    for (k = 0; k < N; ++k) {
      right_side[i] += y[k] * v[k];
    }
    for (j = 0; j <= i; ++j) {
      motion_rigid_velocity(j, q, middle, x);
      matrix[i][j] = 0.0;
      for (k = 0; k < N; ++k) {
        matrix[i][j] += x[k] * y[k];
      }
    }
  }
  /* L D L^T; a motion that moves nothing, as about the line on which all nodes lie, has no share. */
  for (i = 0; i < N_RIGID; ++i) {
    const double whole = matrix[i][i];
    for (j = 0; j < i; ++j) {
      const double value = matrix[i][j];
      for (k = 0; k < j; ++k) {
        matrix[i][j] -= matrix[i][k] * matrix[k][k] * matrix[j][k];
      }
      matrix[i][j] = matrix[j][j] > 0.0 ? matrix[i][j] / matrix[j][j] : 0.0 * value;
      matrix[i][i] -= matrix[i][j] * matrix[i][j] * matrix[j][j];
    }
    matrix[i][i] = matrix[i][i] > 1e-12 * whole ? matrix[i][i] : 0.0;
    for (j = 0; j < i; ++j) {
      right_side[i] -= matrix[i][j] * right_side[j];
    }
  }
  for (i = N_RIGID - 1; i >= 0; --i) {
    right_side[i] = matrix[i][i] > 0.0 ? right_side[i] / matrix[i][i] : 0.0;
    for (j = i + 1; j < N_RIGID; ++j) {
      right_side[i] -= matrix[j][i] * right_side[j];
    }
  }
  for (i = 0; i < N_RIGID; ++i) {
    motion_rigid_velocity(i, q, middle, x);
    for (k = 0; k < N; ++k) {
      v[k] -= right_side[i] * x[k];
    }
  }
}

#endif
/* Bring the state back to `energy` by the smallest change of velocities, in the metric of H, that keeps momentum and
 * angular momentum: d = v, less its rigid motion where all nodes are free, grows by a factor (Hairer, Lubich and Wanner
 * 2006, IV.4). Steps change the energy by their error only; where d holds too little for that nothing is done. */
static inline void motion_keep_energy(
    double energy, double *state, const motion_arguments *with, energy_memory *memory)
{
  double *mass = memory->mass, *d = memory->internal, *momentum = memory->momentum;
  double twice = 0.0, missing, factor;
  int k;
  motion_mass_matrix(state, with, mass);
  for (k = 0; k < N; ++k) {
    d[k] = state[N + k];
  }
#if WITH_RIGID_MOTION
  motion_remove_rigid(mass, state, d, memory->spare);
#endif
  motion_multiply_mass(mass, d, momentum);
  for (k = 0; k < N; ++k) {
    twice += d[k] * momentum[k];
  }
  missing = 2.0 * (energy - motion_energy(state, state + N, with));
  if (!(fabs(missing) < 1e-2 * twice)) {
    return;
  }
  factor = missing / twice;
  factor = factor / (1.0 + sqrt(1.0 + factor));
  for (k = 0; k < N; ++k) {
    state[N + k] += factor * d[k];
  }
}

#endif

#endif
