#ifndef CONTROL_LOOP_MEMORY_H
#define CONTROL_LOOP_MEMORY_H
#include "closed_loop_config.h"

/* One simulated loop: what is given, memory, and arrays that are filled. */
typedef struct {
  long long count;          /* samples */
  const real *start;        /* (N_PLANT,) state of the plant at time 0 */
  const real *noise;        /* (count, N_Y) added to the measurements */
  long long n_changes;      /* changes of the loads */
  const double *change_time; /* (n_changes,) [s], rising */
  const real *load;         /* (n_changes + 1, LOAD_SIZE) before, between and after them */
  long long n_arrivals;     /* times in a sample at which commands arrive at the plant */
  const double *arrival_time; /* (n_arrivals,) [s] after a sample, from 0 on */
  const int *arrival;       /* (N_U,) at which of them those of each actuator arrive */
  const int *delay_samples; /* (N_U,) whole samples before */
  const real *most_change;  /* (N_U,) [m] that the actuator can move from one command to the next */
  long long n_before;       /* rows of commands before the first one */
  plant_arguments with;     /* arguments of the plant, which change on the way */
  scene_control *controller; /* memory of any content */
  real *work;               /* memory of the integrator */
  real *values;             /* memory of a measured quantity */
  real *state;              /* (count + 1, N_PLANT) of the plant */
  real *tension;            /* (count + 1, N_TENSIONS) [N] */
  real *command;            /* (n_before + count, N_U) [m] */
  real *applied;            /* (N_U,) [m] where the actuators are */
  real *input;              /* (count, N_IN) at the end of each sample */
  real *estimate;           /* (count, N_X) */
  real *disturbance;        /* (count, N_Q) */
  int *status;              /* (count,) of each step of the controller */
#if WITH_DISTRIBUTION
  int *yields;              /* (count, N_DRIVEN) whether a least tension yields */
#endif
  long long n_done;         /* samples that are complete */
  int plant_status;         /* of the last call of the plant */
  int is_lost;              /* whether the estimate was not finite */
} closed_loop;

#endif
