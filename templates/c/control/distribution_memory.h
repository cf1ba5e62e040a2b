#ifndef DISTRIBUTION_MEMORY_H
#define DISTRIBUTION_MEMORY_H
#include "distribution_config.h"

/* One quadratic program: least |A x - b|^2 within bounds. A: rows of their own, and below them a multiple of the unit
 * matrix. Set before it is solved: the first rows of the matrix, target, sum, lower, upper, tolerance. Triangles are
 * stored row by row. */
typedef struct {
  real matrix[SCENE_CONTROL_SIZE_MATRIX];      /* A, row by row; overwritten by its factors */
  real target[SCENE_CONTROL_N_TARGETS];        /* b */
  real sum[SCENE_CONTROL_N_SUMMED * SCENE_CONTROL_N_ACTUATORS]; /* rows of norm 1, whose products with x have bounds */
  real lower[SCENE_CONTROL_N_BOUNDS], upper[SCENE_CONTROL_N_BOUNDS]; /* of x, then of the sums */
  real tolerance;                                                    /* of bounds */
  real x[SCENE_CONTROL_N_ACTUATORS];
  real reflection[SCENE_CONTROL_N_ROWS * SCENE_CONTROL_N_ACTUATORS], strength[SCENE_CONTROL_N_ACTUATORS]; /* Q */
  real root[SCENE_CONTROL_SIZE_TRIANGLE], inverse[SCENE_CONTROL_SIZE_TRIANGLE]; /* R; R^-1, rows of norm 1 */
  real turned_sum[SCENE_CONTROL_N_SUMMED * SCENE_CONTROL_N_ACTUATORS];          /* sum R^-1, rows of norm 1 */
  real scaling[SCENE_CONTROL_N_BOUNDS];                                         /* 1 over the norms before */
  real least[SCENE_CONTROL_N_BOUNDS], most[SCENE_CONTROL_N_BOUNDS], product[SCENE_CONTROL_N_SUMMED]; /* for DAQP */
  real shift[SCENE_CONTROL_N_ACTUATORS], move[SCENE_CONTROL_N_ACTUATORS];
  real multiplier[SCENE_CONTROL_N_SET], stationary[SCENE_CONTROL_N_SET], spare[2 * SCENE_CONTROL_N_SET];
  real factor[SCENE_CONTROL_SIZE_FACTOR], diagonal[SCENE_CONTROL_N_SET];
  /* State of each constraint, of which the next sample begins with the active ones; active constraints. */
  int sense[SCENE_CONTROL_N_BOUNDS], set[SCENE_CONTROL_N_SET];
  int is_inverted, iterations;
} scene_control_program;

/* Distribution of tensions of one sample. Driven members are those that actuators pull. */
typedef struct {
  int yields[SCENE_CONTROL_N_DRIVEN]; /* whether a least tension cannot be reached, and yields */
  int iterations;                     /* most of DAQP in one of the programs */
  real length[SCENE_CONTROL_N_MEMBERS], entry[SCENE_CONTROL_SIZE_EQUILIBRIUM];
  real equilibrium[SCENE_CONTROL_N_COORDINATES * SCENE_CONTROL_N_DRIVEN]; /* columns of driven members, row by row */
  real mean_root, largest; /* of all entries of the equilibrium matrix: root of the mean square, largest size */
  real base[SCENE_CONTROL_N_DRIVEN], preferred[SCENE_CONTROL_N_DRIVEN], asked[SCENE_CONTROL_N_DRIVEN];
  real tension[SCENE_CONTROL_N_DRIVEN], slope[SCENE_CONTROL_N_DRIVEN]; /* at the command; derivatives by rest lengths */
  real part[SCENE_CONTROL_N_PULLS], size[SCENE_CONTROL_N_ACTUATORS];
  real top[SCENE_CONTROL_N_ACTUATORS], shared_top[SCENE_CONTROL_N_SUMMED]; /* upper bounds of inputs, and of sums */
  scene_control_program program;
} scene_control_distribution;

#endif
