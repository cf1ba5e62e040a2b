/* Sample of the configuration that the generator writes in place of this file: sizes, tables and the functions of the
 * model. With it every file of this folder compiles alone. The structure is a mass of 1 kg between two springs of
 * 100 N/m, of which an actuator moves one; it is to move by 0.1 m in 1 s. The length of that spring is measured. */
#ifndef CONTROL_CONFIG_H
#define CONTROL_CONFIG_H

#include <stddef.h>
#include <string.h>

#include "../settings.h"

#ifndef WITH_ESTIMATOR
#define WITH_ESTIMATOR 1 /* the state is estimated from measurements */
#endif
#ifndef WITH_GAINS
#define WITH_GAINS 1 /* feedback; else the inputs of the motion alone */
#endif
#ifndef WITH_MPC
#define WITH_MPC 0 /* commands are planned over a horizon */
#endif
#ifndef WITH_POLICY
#define WITH_POLICY 0 /* a network observes and acts */
#endif
#define WITH_CLIP (!WITH_DISTRIBUTION && !WITH_MPC) /* commands are cut to rates and ranges */
#define WITH_DISTURBANCE WITH_ESTIMATOR /* the estimator has disturbance forces */
#define WITH_SUMS (WITH_GAINS || WITH_MPC) /* feedback of sums of errors */
#define WITH_PUSH (WITH_DISTURBANCE && !WITH_SUMS) /* disturbance forces are predicted, for nothing is summed */
#define WITH_DELAY (!WITH_POLICY)       /* commands act after delays */
#define WITH_PAST WITH_GAINS            /* feedback of commands on their way */
#ifndef WITH_DISTRIBUTION
#define WITH_DISTRIBUTION 0 /* tensions are distributed by a quadratic program */
#endif

/* Sizes that the header of a controller states. */
enum {
  SCENE_CONTROL_N_COORDINATES = 1,
  SCENE_CONTROL_N_STATES = 2,
  SCENE_CONTROL_N_ACTUATORS = 1,
  SCENE_CONTROL_N_INPUTS = 1,
  SCENE_CONTROL_N_SUMS = WITH_SUMS,
  SCENE_CONTROL_N_PAST = 2 * WITH_PAST, /* commands on their way that gains know */
  SCENE_CONTROL_N_SENSORS = 1,
  SCENE_CONTROL_SIZE_LAYER = 2, /* of the widest layer of a network */
  SCENE_CONTROL_N_DISTURBANCES = WITH_DISTURBANCE,
  SCENE_CONTROL_N_SENT = 3,        /* commands that are kept, for delays */
  SCENE_CONTROL_SIZE_MEASURED = 1, /* numbers from which measurements are taken */
  SCENE_CONTROL_SIZE_MASS = 1,     /* entries of the mass matrix in its envelope */
  SCENE_CONTROL_SIZE_ENTRIES = 1   /* entries of the mass matrix of the model */
};

enum {
  N_Q = SCENE_CONTROL_N_COORDINATES,
  N_X = SCENE_CONTROL_N_STATES,
  N_U = SCENE_CONTROL_N_ACTUATORS,
  N_IN = SCENE_CONTROL_N_INPUTS,         /* inputs of the model, those of the actuators among them */
  N_Z = SCENE_CONTROL_N_SUMS,            /* sums of errors */
  N_PAST = SCENE_CONTROL_N_PAST,         /* commands on their way */
  N_K = N_X + N_Z + N_PAST,              /* columns of the gains */
  N_Y = SCENE_CONTROL_N_SENSORS,         /* measured numbers */
  N_D = SCENE_CONTROL_N_DISTURBANCES,    /* disturbance forces */
  N_E = N_X + N_D,                       /* rows of the gains of the estimator */
  N_SENT = SCENE_CONTROL_N_SENT,
  N_STRETCH = 2,                         /* parts of a sample between arrivals of commands */
  N_MOTION = 2, N_GAIN = 2, N_FILTER = 2, /* knots: two at least */
  SUBSTEPS = 2                           /* Runge-Kutta steps in a sample */
};

static const real CONTROL_SAMPLE = (real)0.01; /* [s] */
static const real SAME_SPAN = (real)1e-6;      /* of a sample, by which one may be longer or shorter */
static const real SAME_COMMAND = (real)1e-12;  /* [m], by which a command may differ from what is wanted */

#if WITH_POLICY
/* Network: sizes of the observation and of all layers; where each observed number comes from, one of the caller or, below
 * zero, a command sent last; normalisation; layers; inputs at the start, middle and half width of the ranges [m]. */
enum { N_LAYERS = 2, N_WIDTH = SCENE_CONTROL_SIZE_LAYER };
static const int POLICY_SIZE[N_LAYERS + 1] = {2, 2, N_U};
static const int POLICY_SOURCE[2] = {0, -1};
static const real POLICY_MEAN[2] = {(real)1.0, (real)0.0}, POLICY_SCALE[2] = {(real)0.1, (real)0.5};
static const real POLICY_CLIP[1] = {(real)10.0};
static const real POLICY_WEIGHT[6] = {(real)0.5, (real)0.1, (real)-0.5, (real)0.2, (real)1.0, (real)-1.0};
static const real POLICY_BIAS[3] = {(real)0.1, (real)0.0, (real)0.0};
static const real START_INPUT[N_IN] = {(real)0.0};
static const real ACTION_CENTRE[N_U] = {(real)0.0}, ACTION_HALF_RANGE[N_U] = {(real)0.5};

/* Result of a neuron. */
static inline real policy_activate(int is_last, real sum)
{
  return is_last ? sum : sum > (real)0.0 ? sum : (real)0.0;
}
#else
/* Knots of the motion: time; coordinates, velocities, accelerations, and by how much coordinates at the next knot differ
 * from a parabola through this one; values and slopes of all inputs. */
static const real MOTION_TIME[N_MOTION] = {(real)0.0, (real)1.0};
static const real MOTION_STATE[N_MOTION * 4 * N_Q] = {
    (real)0.0, (real)0.0, (real)0.0, (real)0.1, (real)0.1, (real)0.0, (real)0.0, (real)0.0};
static const real MOTION_INPUT[N_MOTION * 2 * N_IN] = {(real)0.0, (real)0.0, (real)0.2, (real)0.0};
#endif

/* Actuators: place of each among the inputs, bounds of its input [m], rate [m/s], whole samples and rest [s] of its
 * delay; rest lengths without inputs, and which inputs change them. */
static const int ACTUATOR_PLACE[N_U] = {0};
static const real ACTUATOR_LEAST[N_U] = {(real)-0.5}, ACTUATOR_MOST[N_U] = {(real)0.5};
static const real ACTUATOR_RATE[N_U] = {(real)1.0};
static const int DELAY_SAMPLES[N_U] = {1};
static const real DELAY_REST[N_U] = {(real)0.004};
static const real REST_LENGTH[N_U] = {(real)1.0};
static const int REST_START[N_U + 1] = {0, 1};
static const int REST_INPUT[1] = {0};

#if WITH_GAINS
static const real GAIN_TIME[N_GAIN] = {(real)0.0, (real)1.0};
static const real GAIN[N_GAIN * N_U * N_K] = {
    (real)0.5, (real)0.1, (real)0.01, (real)0.2, (real)0.1, (real)0.6, (real)0.1, (real)0.01, (real)0.2, (real)0.1};
static const int PAST_START[N_U + 1] = {0, N_PAST}; /* where the commands of each actuator begin */
#endif
#if WITH_SUMS
static const real SUM_OUTPUT[N_Z * N_X] = {(real)1.0, (real)0.0}; /* what is summed, of the errors of the state */
#endif

#if WITH_ESTIMATOR || WITH_MPC
/* Accelerations of the model; returns 0, or another number where they are not finite. */
static inline int control_acceleration(
    const real *coordinate, const real *velocity, const real *input, real *acceleration)
{
  acceleration[0] = (real)-200.0 * coordinate[0] + (real)100.0 * input[0] - velocity[0];
  return 0;
}
#endif

#if WITH_ESTIMATOR
static const real STRETCH_START[N_STRETCH] = {(real)0.0, (real)0.004}; /* [s] */
static const real FILTER_TIME[N_FILTER] = {(real)0.0, (real)1.0};
static const real FILTER_GAIN[N_FILTER * N_E * N_Y] = {
    (real)0.5, (real)5.0, (real)10.0, (real)0.5, (real)5.0, (real)10.0};
static const real FILTER_WEIGHT[N_FILTER * N_Y] = {(real)1000.0, (real)1000.0}; /* 1 over standard deviations */
static const unsigned char IS_LENGTH[N_Y] = {1}; /* measured numbers that are lengths, above 0 */

/* Expected measurements; memory: of the size SCENE_CONTROL_SIZE_MEASURED. */
static inline int control_measure(
    const real *coordinate, const real *velocity, const real *input, real *memory, real *measured)
{
  (void)velocity;
  (void)input;
  memory[0] = (real)1.0 + coordinate[0];
  measured[0] = memory[0];
  return 0;
}

#if WITH_DISTURBANCE
static const int DISTURBED[N_D] = {0};                    /* coordinates with a disturbance force */
static const int MASS_FIRST[N_Q] = {0}, MASS_ROW[N_Q] = {0}; /* envelope: first column and place of each row */

/* Lower half of the mass matrix in its envelope; memory: of the size SCENE_CONTROL_SIZE_ENTRIES. */
static inline int control_mass(const real *coordinate, const real *input, real *memory, real *mass)
{
  (void)coordinate;
  (void)input;
  memory[0] = (real)1.0;
  mass[0] = memory[0];
  return 0;
}
#endif
#endif

#endif
