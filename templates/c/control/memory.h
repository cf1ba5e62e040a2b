#ifndef CONTROL_MEMORY_H
#define CONTROL_MEMORY_H
#include "config.h"
#if WITH_DISTRIBUTION
#include "distribution_memory.h"
#endif
#if WITH_MPC
#include "mpc_memory.h"
#endif

/* What init and step return. From NON_FINITE_INPUT on the command is the last one. */
enum {
  SCENE_CONTROL_OK = 0,               /* the command is what feedback asks for, or gives the same forces */
  SCENE_CONTROL_RATE_LIMITED = 1,     /* the command was cut to the rate of an actuator */
  SCENE_CONTROL_RANGE_LIMITED = 2,    /* the command was cut to the range of an actuator */
  SCENE_CONTROL_TENSION_LIMITED = 3,  /* least tensions or ranges of coordinates prevent what feedback asks for */
  SCENE_CONTROL_LEAST_TENSION = 4,    /* a least tension or range of a coordinate cannot be kept within rates, and yields */
  SCENE_CONTROL_NOT_SOLVED = 5,       /* a quadratic program failed; the command is that of feedback or of the last plan, cut */
  SCENE_CONTROL_NON_FINITE_INPUT = 6, /* a time, measurement or state is NAN or infinite */
  SCENE_CONTROL_INVALID_LENGTH = 7,   /* a measured length is not above 0 */
  SCENE_CONTROL_LATE = 8,             /* more than 1.5 samples after the expected time */
  SCENE_CONTROL_REPEATED_TIME = 9,    /* not after the time of the last step; the third rising one is LATE */
  SCENE_CONTROL_ESTIMATE_LOST = 10,   /* the estimate was not finite, and starts again from the motion */
  SCENE_CONTROL_NULL_POINTER = 11,    /* a pointer that is needed is NULL */
  SCENE_CONTROL_NOT_INITIALISED = 12, /* init was not called with this memory */
  SCENE_CONTROL_OUTLIER = 13          /* a measurement is too far from its prediction */
};

/* Memory of one controller, of which fields may be read. Coordinates, velocities and inputs have the order and units of
 * the scene. */
typedef struct {
  int status;                                   /* of the last step */
  long n_steps;                                 /* steps since init at which time went on, at most 2^31 - 1 */
  real time;                                    /* of the last step [s] */
  real command[SCENE_CONTROL_N_ACTUATORS];      /* input of each actuator, the change of its rest lengths [m] */
  real wanted[SCENE_CONTROL_N_ACTUATORS];       /* input that feedback asked for [m] */
#if WITH_POLICY
  real action[SCENE_CONTROL_N_ACTUATORS];       /* of the network, -1 to 1 */
#else
  real deviation[SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_SUMS + SCENE_CONTROL_N_PAST]; /* state minus that of the
    motion; sums; commands on their way minus those of the motion, of each actuator the latest first */
  real estimate[SCENE_CONTROL_N_STATES + SCENE_CONTROL_N_DISTURBANCES]; /* coordinates, velocities, forces */
  real disturbance[SCENE_CONTROL_N_COORDINATES]; /* estimated force on each coordinate [N or N m] */
#endif
  real input[SCENE_CONTROL_N_INPUTS];           /* inputs of the model now */
  real sent[SCENE_CONTROL_N_SENT * SCENE_CONTROL_N_ACTUATORS]; /* last commands, in a ring */
  int newest;                                   /* row of the last one */
  unsigned int ready;                           /* whether init was called */
  int n_refused;                                /* last steps that were not after the time, themselves rising */
  real refused_time;                            /* of the last one of these [s] */
#if WITH_ESTIMATOR
  real innovation;                              /* recent largest distance of measurements from their prediction,
                                                   over its standard deviation */
  int n_outliers;                               /* last measurements that were not used, in a row */
#endif
#if WITH_DISTRIBUTION
  scene_control_distribution distribution; /* of the last step */
#endif
#if WITH_MPC
  scene_control_mpc mpc; /* the plan of the last step */
#endif
  struct {
#if WITH_POLICY
    real layer[2 * SCENE_CONTROL_SIZE_LAYER]; /* numbers before and behind a layer of the network */
#else
    real goal[SCENE_CONTROL_N_STATES];
#endif
    real low[SCENE_CONTROL_N_ACTUATORS], high[SCENE_CONTROL_N_ACTUATORS];
#if WITH_DELAY
    real planned[SCENE_CONTROL_N_ACTUATORS]; /* inputs of the motion when the command acts [m] */
#endif
#if WITH_ESTIMATOR
    real state[SCENE_CONTROL_N_STATES], stage[SCENE_CONTROL_N_STATES], rate[4 * SCENE_CONTROL_N_STATES];
    real push[SCENE_CONTROL_N_COORDINATES];
    real expected[SCENE_CONTROL_N_SENSORS];
    real values[SCENE_CONTROL_SIZE_MEASURED];
#if WITH_DISTURBANCE
    real mass[SCENE_CONTROL_SIZE_MASS], mass_entry[SCENE_CONTROL_SIZE_ENTRIES];
#endif
#endif
  } work; /* nothing in here outlives a step */
} scene_control;

#endif
