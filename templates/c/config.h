/* Sample of the configuration that the generator writes in place of this file and of tableau.h: sizes, the type of
 * numbers, and the functions of the structure. With it every file of this folder compiles alone. The structure is N
 * unit masses, each on a spring of its own: q'' = -stiffness q. */
#ifndef CONFIG_H
#define CONFIG_H

#include <limits.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "profile.h"
#include "run.h"
#include "settings.h"

#if defined(__cplusplus)
#define TENSEGRITY_RESTRICT __restrict
#else
#define TENSEGRITY_RESTRICT restrict
#endif

enum {
  N = CONFIG_N,             /* coordinates */
  N_INTERNAL = WITH_INTERNAL ? 1 : 0,
  N_STATES = 2 * N + N_INTERNAL, /* coordinates, velocities, internal states */
  N_SLOPES = N + N_INTERNAL,     /* accelerations, rates of internal states */
  N_OLD = N_STATES + N_SLOPES,   /* a state and these */
  WIDTH = 8,                /* lanes of a batch */
  LINE = 64 / sizeof(real), /* numbers in a line of the cache */
  N_ARGUMENTS = 1,          /* what accelerations take beside coordinate and velocity */
  FIRST_CONTACT = 0,        /* first margin of a contact */
  N_CONTACTS = 1,
  N_KINKS = 1, /* margins of contacts from there on, at which forces do not jump */
  FIRST_STICK = 0,
  N_SLIPS = N_INTERNAL, /* last internal states: 1 where a contact slips or is open, 0 where it sticks */
  N_YIELDS = N_INTERNAL, /* the last of these, of plastic members */
  N_MARGINS = 2,            /* events that are watched, the condition last */
  N_MEASURED = N,           /* coordinates whose size counts as rounding */
  MAX_RAPID_EVENTS = 150, /* events, each within a thousandth of a step of the last one */
  N_MASSES = N,             /* entries of the mass matrix */
  AXES = WITH_AXES_3 ? 3 : 1,
  N_RIGID = WITH_AXES_3 ? 6 : 1, /* rigid motions */
  N_DRIVEN = 1,                  /* numbers that can change with time */
  N_STATE_JACOBIAN = 2 * N,      /* numbers that it has */
  N_DIRECTED = 1,                /* run-time parameters and inputs */
  N_COLUMNS = 1,             /* numbers that a motion is differentiated to */
  N_MOVED = 2 * N + N_INTERNAL, /* states without these derivatives */
  N_VARIED = N_MOVED + N_DIRECTED,
  N_CABLE_MARGINS = 1
};

/* What the functions take beside coordinate and velocity. */
typedef struct {
  const real *stiffness;
#if WITH_DIRECTION
  const real *direction;
#endif
#if WITH_PROFILE
  motion_profile *profile; /* NULL: the others are constant */
#endif
} motion_arguments;

/* Accelerations at (coordinate, velocity). */
static inline void motion_slope(
    const real *coordinate, const real *velocity, const motion_arguments *with, real *result)
{
  int k;
  (void)velocity;
  for (k = 0; k < N; ++k) {
    result[k] = -with->stiffness[0] * coordinate[k];
  }
}

#if WITH_INTERNAL
/* Rates of coordinates, velocities and internal states, which are `velocity + N`: one that follows a coordinate. */
static inline void motion_state_derivative(
    const real *coordinate, const real *velocity, const motion_arguments *with, real *result)
{
  const real *internal = velocity + N;
  int k;
  for (k = 0; k < N; ++k) {
    result[k] = velocity[k];
  }
  motion_slope(coordinate, velocity, with, result + N);
  result[2 * N] = coordinate[0] - internal[0];
}

/* What internal states become at events. */
static inline void motion_settled_internal(
    const real *coordinate, const real *velocity, const motion_arguments *with, real *result)
{
  (void)with;
  result[0] = velocity[N] < coordinate[0] ? velocity[N] : coordinate[0];
}
#endif

/* The Jacobian of the state derivative, column by column: v' to q, then q' to v. */
extern const int scene_state_jacobian_row[N_STATE_JACOBIAN], scene_state_jacobian_column_start[2 * N + 1];

static inline void motion_state_jacobian(
    const real *coordinate, const real *velocity, const motion_arguments *with, real *result)
{
  int k;
  (void)coordinate;
  (void)velocity;
  for (k = 0; k < N; ++k) {
    result[k] = -with->stiffness[0];
    result[N + k] = (real)1.0;
  }
}

#if WITH_COLUMNS || WITH_ADJOINT
static const int motion_driven_row[N_DRIVEN] = {0}; /* row in a direction of each number that follows a profile */
#endif

#if WITH_ADJOINT
/* Weights of the rates of a state, as weights of the state and of what a direction has. */
static inline void motion_adjoint_rate(
    const real *coordinate, const real *velocity, const real *weight, const motion_arguments *with, real *result)
{
  int k;
  (void)velocity;
  result[N_MOVED] = (real)0.0;
  for (k = 0; k < N; ++k) {
    result[k] = -with->stiffness[0] * weight[N + k];
    result[N + k] = weight[k];
    result[N_MOVED] -= coordinate[k] * weight[N + k];
  }
#if WITH_INTERNAL
  result[0] += weight[2 * N];
  result[2 * N] = -weight[2 * N];
#endif
}

/* Weights of the margins. */
static inline void motion_adjoint_margin(
    const real *coordinate, const real *velocity, const real *weight, const motion_arguments *with, real *result)
{
  int k;
  (void)coordinate;
  (void)velocity;
  (void)with;
  for (k = 0; k < N_VARIED; ++k) {
    result[k] = k == 0 ? weight[0] : (real)0.0;
  }
}
#endif

#if WITH_COLUMNS || WITH_ADJOINT
/* What the rates of a state jump by where cables are pulled taut, times a weight each. */
static inline void motion_margin_jump(
    const real *coordinate, const real *velocity, const real *weight, const motion_arguments *with, real *result)
{
  int k;
  (void)coordinate;
  (void)with;
  for (k = 0; k < N_MOVED; ++k) {
    result[k] = k == N ? -weight[0] * velocity[0] : (real)0.0;
  }
}
#endif

#if WITH_COLUMNS

/* Rates of a state, and of the derivatives of a motion behind it, row by row. */
static inline void motion_column_rate(
    const real *coordinate, const real *velocity, const motion_arguments *with, real *result)
{
  real *column = result + N_MOVED;
  int k;
  motion_state_derivative(coordinate, velocity, with, result);
  for (k = 0; k < N; ++k) {
    column[k] = coordinate[N_MOVED + N + k];
    column[N + k] = -with->stiffness[0] * coordinate[N_MOVED + k] - with->direction[0] * coordinate[k];
  }
}

/* Derivatives of the margins. */
static inline void motion_margin_column(
    const real *coordinate, const real *velocity, const motion_arguments *with, real *result)
{
  (void)velocity;
  (void)with;
  result[0] = coordinate[N_MOVED];
}
#endif

/* Bring (q, v) back onto the constraints between coordinates; these have none. */
static inline void motion_project(real *coordinate, real *velocity, const motion_arguments *with, real *spare)
{
  (void)coordinate;
  (void)velocity;
  (void)with;
  (void)spare;
}

#if WITH_ENERGY
/* Energy at (q, v). */
static inline double motion_energy(const double *coordinate, const double *velocity, const motion_arguments *with)
{
  double energy = 0.0;
  int k;
  for (k = 0; k < N; ++k) {
    energy += 0.5 * (velocity[k] * velocity[k] + with->stiffness[0] * coordinate[k] * coordinate[k]);
  }
  return energy;
}

/* Entries of the mass matrix. */
static inline void motion_mass_matrix(const double *coordinate, const motion_arguments *with, double *mass)
{
  int k;
  (void)coordinate;
  (void)with;
  for (k = 0; k < N; ++k) {
    mass[k] = 1.0;
  }
}
#endif

#if WITH_EVENTS
static const double EVENT_SIZE = 1.0; /* longest member [m] */

/* Margins at a time and state: the first coordinate, and a condition. Those that are not watched stay at one. */
static inline void event_margins(
    double time, const double *coordinate, const double *velocity, const motion_arguments *with, const scene_run *run,
    double *margin)
{
  (void)with;
#if WITH_PROFILE
  profile_set_time(time, with->profile);
#endif
  margin[0] = run->watch & SCENE_EVENT_CABLE ? coordinate[0] : 1.0;
  margin[1] = 1.0;
  if ((run->watch & SCENE_EVENT_CONDITION) && run->condition != NULL) {
    margin[1] = run->condition(time, coordinate, velocity, run->condition_data);
  }
}

/* Kind of the event of margin k, and which member or pair of bars it is. */
static inline void event_name(int k, int *kind, int *which)
{
  *kind = k == 0 ? SCENE_EVENT_CABLE : SCENE_EVENT_CONDITION;
  *which = 0;
}
#endif

#endif
