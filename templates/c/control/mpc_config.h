/* Sample of what the generator writes in place of this file for model-predictive control: the mass between two springs of
 * config.h, over a horizon of three commands in two blocks. */
#ifndef MPC_CONFIG_H
#define MPC_CONFIG_H
#include "config.h"

#include <math.h>

#define WITH_LIMITED 1 /* some members have a least tension */

/* Sizes that the header of a controller states. */
enum {
  SCENE_CONTROL_N_HORIZON = 3,   /* commands in the horizon */
  SCENE_CONTROL_N_STAGES = 5,    /* samples in the horizon: the commands, and their longest delay */
  SCENE_CONTROL_N_BLOCKS = 2,    /* groups of commands with the same deviation from the inputs of the motion */
  SCENE_CONTROL_N_VARIABLES = 2, /* blocks times actuators */
  SCENE_CONTROL_N_WEIGHTED = 3,  /* largest number of weighted sums of the errors of one state */
  SCENE_CONTROL_N_LIMITED = 1,   /* members with a least tension */
  SCENE_CONTROL_N_BOUNDED = 1,   /* coordinates with bounds */
  SCENE_CONTROL_N_SOFT = 4,      /* blocks times both */
  SCENE_CONTROL_N_ROWS = 5,      /* constraints that are no simple bounds: rates between blocks, and the soft ones */
  SCENE_CONTROL_N_CONSTRAINTS = 7, /* simple bounds and rows */
  SCENE_CONTROL_N_SET = 7,       /* most active constraints: variables, soft rows, and one more */
  SCENE_CONTROL_SIZE_TRIANGLE = 3, /* entries of a triangle of a matrix of variables */
  SCENE_CONTROL_SIZE_FACTOR = 28,  /* entries of a triangle of a matrix of active constraints */
  SCENE_CONTROL_SIZE_CALL = 4    /* largest result of the model, at least the number of its members */
};

enum {
  N_HORIZON = SCENE_CONTROL_N_HORIZON,
  N_STAGES = SCENE_CONTROL_N_STAGES,
  N_BLOCKS = SCENE_CONTROL_N_BLOCKS,
  N_V = SCENE_CONTROL_N_VARIABLES,
  N_S = N_X + N_Z, /* errors of the state and their sums */
  N_C = N_X + N_U, /* derivatives by the state and by the inputs */
  N_LIMITED = SCENE_CONTROL_N_LIMITED,
  N_BOUNDED = SCENE_CONTROL_N_BOUNDED,
  N_SOFT = SCENE_CONTROL_N_SOFT,
  N_ROWS = SCENE_CONTROL_N_ROWS,
  N_CONSTRAINTS = SCENE_CONTROL_N_CONSTRAINTS,
  N_SET = SCENE_CONTROL_N_SET,
  N_WEIGHTED = 2,     /* weighted sums of the errors of a state before the last one */
  LEAST_DELAY = 1,    /* whole samples of the shortest delay */
  MPC_SUBSTEPS = 1,   /* Runge-Kutta steps in a sample */
  QP_ITERATIONS = 100 /* most in one quadratic program */
};

/* First command of each block. */
static const int BLOCK_START[N_BLOCKS + 1] = {0, 1, 3};

/* Weights of errors: sums whose squares are the cost of a state, and (the upper triangle of a factor) of the last one;
 * of the deviations of inputs; of the soft constraints. */
static const int WEIGHT_START[N_WEIGHTED + 1] = {0, 1, 2}, WEIGHT_COLUMN[2] = {0, 1};
static const real WEIGHT_ROOT[2] = {(real)10.0, (real)1.0};
static const real LAST_ROOT[N_S * (N_S + 1) / 2] = {
    (real)20.0, (real)1.0, (real)0.1, (real)2.0, (real)0.1, (real)1.0};
static const real INPUT_WEIGHT[N_U * N_U] = {(real)1.0};
static const real SOFT_WEIGHT[1] = {(real)1e3};

/* Place of each entry of the derivatives of the accelerations, by the state and by the inputs, in matrices of N_Q rows;
 * -1: in none. */
static const int STATE_PLACE[4] = {-1, 0, -1, 1}, INPUT_PLACE[1] = {0};

/* Members with a least tension: index, stiffnesses [N/m, N], rest length without inputs [m], least tension [N]; actuators
 * and other inputs that change the rest length; place of each entry of the equilibrium matrix in their rows. */
static const int LIMITED_MEMBER[N_LIMITED] = {0};
static const real LIMITED_SPRING[N_LIMITED] = {(real)100.0}, LIMITED_AXIAL[N_LIMITED] = {(real)0.0};
static const real LIMITED_REST[N_LIMITED] = {(real)0.9}, LIMITED_TENSION[N_LIMITED] = {(real)1.0};
static const int LIMITED_PULL_START[N_LIMITED + 1] = {0, 1}, LIMITED_PULL[1] = {0};
static const int LIMITED_OTHER_START[N_LIMITED + 1] = {0, 0}, LIMITED_OTHER[1] = {0};
static const int LENGTH_PLACE[2] = {0, -1};

/* Coordinates with bounds. */
static const int BOUNDED[N_BOUNDED] = {0};
static const real BOUNDED_LEAST[N_BOUNDED] = {(real)-0.5}, BOUNDED_MOST[N_BOUNDED] = {(real)0.5};

/* How far a planned coordinate may be from the motion. */
static const real PLAN_REACH[N_Q] = {(real)2.0};

/* Entries of the derivatives of velocities and accelerations by the state, column by column, and of the accelerations by
 * the inputs. */
static inline int mpc_derivatives(
    const real *coordinate, const real *velocity, const real *input, real *by_state, real *by_input)
{
  (void)coordinate;
  (void)velocity;
  (void)input;
  by_state[0] = (real)0.0;
  by_state[1] = (real)-200.0;
  by_state[2] = (real)1.0;
  by_state[3] = (real)-1.0;
  by_input[0] = (real)100.0;
  return 0;
}

#if WITH_LIMITED
/* Lengths of the members and entries of the equilibrium matrix. */
static inline int mpc_geometry(const real *coordinate, real *length, real *entry)
{
  length[0] = (real)1.0 + coordinate[0];
  length[1] = (real)1.0 - coordinate[0];
  entry[0] = (real)1.0;
  entry[1] = (real)-1.0;
  return 0;
}
#endif

#endif
