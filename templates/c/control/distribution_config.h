/* Sample of what the generator writes in place of this file for the distribution of tensions: of the two springs of the
 * sample in config.h, the first one is driven. */
#ifndef DISTRIBUTION_CONFIG_H
#define DISTRIBUTION_CONFIG_H
#include "config.h"

#include <math.h>

#define WITH_OTHERS 0 /* inputs that are no actuators' change rest lengths of driven members */

/* Sizes that the header of a controller states. */
enum {
  SCENE_CONTROL_N_MEMBERS = 2,
  SCENE_CONTROL_N_DRIVEN = 1,        /* members that actuators pull */
  SCENE_CONTROL_N_PULLS = 1,         /* pairs of an actuator and a member that it pulls */
  SCENE_CONTROL_N_SHARED = 0,        /* driven members with a least tension that several actuators pull */
  SCENE_CONTROL_N_ROWS = 1,          /* coordinates, and driven members where any is pulled by several actuators */
  SCENE_CONTROL_SIZE_EQUILIBRIUM = 2, /* entries of the equilibrium matrix */
  SCENE_CONTROL_N_TARGETS = 2,       /* rows of the quadratic program: N_ROWS and actuators */
  SCENE_CONTROL_SIZE_MATRIX = 2,     /* entries of its matrix */
  SCENE_CONTROL_N_BOUNDS = 1,        /* of the quadratic program: of actuators and shared members */
  SCENE_CONTROL_N_SUMMED = 1,        /* shared members, one at least */
  SCENE_CONTROL_N_SET = 2,           /* most active constraints: actuators and one more */
  SCENE_CONTROL_SIZE_TRIANGLE = 1,   /* entries of a triangle of a matrix of actuators */
  SCENE_CONTROL_SIZE_FACTOR = 3      /* of a matrix of active constraints */
};

enum {
  N_MEMBERS = SCENE_CONTROL_N_MEMBERS,
  N_DRIVEN = SCENE_CONTROL_N_DRIVEN,
  N_PULLS = SCENE_CONTROL_N_PULLS,
  N_SHARED = SCENE_CONTROL_N_SHARED,
  N_ROWS = SCENE_CONTROL_N_ROWS,
  N_EQUILIBRIUM = SCENE_CONTROL_SIZE_EQUILIBRIUM,
  N_BOUNDS = SCENE_CONTROL_N_BOUNDS,
  N_SUMMED = SCENE_CONTROL_N_SUMMED,
  N_SET = SCENE_CONTROL_N_SET,
  N_PREFERRED = 2,     /* knots of preferred tensions: one, or those of the motion */
  IS_COUPLED = 0,      /* whether any member is pulled by several actuators */
  IS_FIXED = 1,        /* whether one member for each actuator keeps the matrix the same in all steps */
  QP_ITERATIONS = 100, /* most of DAQP in one program */
  QP_PASSES = 4        /* Gauss-Newton steps */
};

/* Driven members: index, stiffnesses [N/m, N], rest length without inputs [m], least tension [N] where it has one. */
static const int DRIVEN_MEMBER[N_DRIVEN] = {0}, IS_LIMITED[N_DRIVEN] = {1};
static const real SPRING_CONSTANT[N_DRIVEN] = {(real)100.0}, AXIAL_STIFFNESS[N_DRIVEN] = {(real)0.0};
static const real DRIVEN_REST[N_DRIVEN] = {(real)0.9}, LEAST_TENSION[N_DRIVEN] = {(real)1.0};
static const real PREFERRED_TENSION[N_PREFERRED * N_DRIVEN] = {(real)10.0, (real)10.0};
static const real WEIGHT_ROOT[1] = {(real)1e-3}; /* root of eps over the mean square of the equilibrium matrix */

/* Driven members of each actuator; actuators, and other inputs, that change the rest length of each driven member. */
static const int PULL_START[N_U + 1] = {0, 1}, PULL_DRIVEN[N_PULLS] = {0};
static const int DRIVEN_START[N_DRIVEN + 1] = {0, 1}, DRIVEN_PULL[N_PULLS] = {0};
#if WITH_OTHERS
static const int OTHER_START[N_DRIVEN + 1] = {0, 0}, OTHER_INPUT[1] = {0};
#endif

/* Place of each entry of the equilibrium matrix in the columns of driven members, row by row; -1: in none of them. */
static const int EQUILIBRIUM_PLACE[N_EQUILIBRIUM] = {0, -1};

/* Lengths of the members and entries of the equilibrium matrix; returns 0, another number if not finite. */
static inline int control_geometry(const real *coordinate, real *length, real *entry)
{
  length[0] = (real)1.0 + coordinate[0];
  length[1] = (real)1.0 - coordinate[0];
  entry[0] = (real)1.0;
  entry[1] = (real)-1.0;
  return !(coordinate[0] - coordinate[0] == (real)0.0);
}

#endif
