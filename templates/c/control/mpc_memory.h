#ifndef MPC_MEMORY_H
#define MPC_MEMORY_H
#include "mpc_config.h"

/* Memory of model-predictive control. The plan outlives a step, and which constraints were active; the rest is work. */
typedef struct {
  int iterations;         /* of DAQP in the last step; 1 where no constraint was active, 0 where there was no program */
  int is_planned;         /* whether there is a plan */
  int is_unfinished;      /* whether the last program needed more iterations */
  real plan_time;         /* for which the plan was made [s] */
  real soft_excess;       /* largest predicted excess over a soft limit [m, or units of the coordinate] */
  real target[SCENE_CONTROL_N_COORDINATES]; /* of the coordinates minus those of the motion; the caller may change it */
  /* Planned states, and deviations of the commands of each block from the inputs of the motion. */
  real state[(SCENE_CONTROL_N_STAGES + 1) * SCENE_CONTROL_N_STATES];
  real move[SCENE_CONTROL_N_VARIABLES];
  int sense[SCENE_CONTROL_N_CONSTRAINTS]; /* state of each constraint, of which the next step begins with the active ones */
  /* The motion over the horizon: states, inputs of the actuators when commands act, all inputs of the model. */
  real goal[(SCENE_CONTROL_N_STAGES + 1) * SCENE_CONTROL_N_STATES];
  real planned[SCENE_CONTROL_N_STAGES * SCENE_CONTROL_N_ACTUATORS];
  real input[SCENE_CONTROL_N_STAGES * SCENE_CONTROL_N_INPUTS];
  /* Linear models of the samples: x_next = transition x + effect u + gap, of changes of the plan. */
  real transition[SCENE_CONTROL_N_STAGES * SCENE_CONTROL_N_STATES * SCENE_CONTROL_N_STATES];
  real effect[SCENE_CONTROL_N_STAGES * SCENE_CONTROL_N_STATES * SCENE_CONTROL_N_ACTUATORS];
  real gap[SCENE_CONTROL_N_STAGES * SCENE_CONTROL_N_STATES];
  real by_state[SCENE_CONTROL_N_COORDINATES * SCENE_CONTROL_N_STATES];
  real by_input[SCENE_CONTROL_N_COORDINATES * SCENE_CONTROL_N_ACTUATORS];
  real entry[SCENE_CONTROL_SIZE_CALL], input_entry[SCENE_CONTROL_SIZE_CALL], length[SCENE_CONTROL_SIZE_CALL];
  real stage[SCENE_CONTROL_N_STATES], rate[4 * SCENE_CONTROL_N_STATES];
  real change[SCENE_CONTROL_N_STATES * (SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_ACTUATORS)];
  real stage_change[SCENE_CONTROL_N_STATES * (SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_ACTUATORS)];
  real change_rate[4 * SCENE_CONTROL_N_STATES * (SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_ACTUATORS)];
  /* Errors of the state and their sums without changes of the moves, and their derivatives by the moves. */
  real error[SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_SUMS], free_change[SCENE_CONTROL_N_STATES];
  real by_move[(SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_SUMS) * SCENE_CONTROL_N_VARIABLES];
  real next_by_move[SCENE_CONTROL_N_STATES * SCENE_CONTROL_N_VARIABLES];
  real weighted[SCENE_CONTROL_N_WEIGHTED * SCENE_CONTROL_N_VARIABLES], weighted_error[SCENE_CONTROL_N_WEIGHTED];
  real length_rate[SCENE_CONTROL_N_LIMITED * SCENE_CONTROL_N_COORDINATES + 1];
  /* The program: least 0.5 x H x + gradient x of changes x of the moves, within bounds of x and of rows times x. */
  real hessian[SCENE_CONTROL_N_VARIABLES * SCENE_CONTROL_N_VARIABLES], gradient[SCENE_CONTROL_N_VARIABLES];
  real row[SCENE_CONTROL_N_ROWS * SCENE_CONTROL_N_VARIABLES + 1];
  real lower[SCENE_CONTROL_N_CONSTRAINTS], upper[SCENE_CONTROL_N_CONSTRAINTS];
  real x[SCENE_CONTROL_N_VARIABLES];
  /* For DAQP: R^-1 and rows R^-1, all of norm 1 after division by scaling; bounds; solution; factors of active rows. */
  real inverse[SCENE_CONTROL_SIZE_TRIANGLE], turned[SCENE_CONTROL_N_ROWS * SCENE_CONTROL_N_VARIABLES + 1];
  real scaling[SCENE_CONTROL_N_CONSTRAINTS], softness[SCENE_CONTROL_N_CONSTRAINTS];
  real least[SCENE_CONTROL_N_CONSTRAINTS], most[SCENE_CONTROL_N_CONSTRAINTS], product[SCENE_CONTROL_N_ROWS + 1];
  real shift[SCENE_CONTROL_N_VARIABLES], move_root[SCENE_CONTROL_N_VARIABLES];
  real multiplier[SCENE_CONTROL_N_SET], stationary[SCENE_CONTROL_N_SET], spare[2 * SCENE_CONTROL_N_SET];
  real factor[SCENE_CONTROL_SIZE_FACTOR], diagonal[SCENE_CONTROL_N_SET];
  int set[SCENE_CONTROL_N_SET];
} scene_control_mpc;

#endif
