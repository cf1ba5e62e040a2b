/* Sample of the settings by which the generator chooses between the branches of the files in this folder. */
#ifndef SETTINGS_H
#define SETTINGS_H

#include <math.h>
#include <stddef.h>

#ifndef CONFIG_N
#define CONFIG_N 15
#endif
#ifndef WITH_FLOAT
#define WITH_FLOAT 0 /* 1: single precision */
#endif
#define WITH_NATIVE (!WITH_FLOAT) /* for the registers of one machine, which are wide */
#define WITH_PROFILE 1            /* arguments can change with time */
#define WITH_EVENTS (!WITH_FLOAT) /* steps are cut at events */
#define WITH_SWITCH_EVENTS 0      /* members whose law switches its slope are watched */
#define WITH_COLLISION_EVENTS 0   /* bars that press each other are watched */
#define WITH_GROUND_EVENTS 0      /* contacts with the ground are watched */
#define WITH_STICK_EVENTS 0       /* and where these stick */
#define WITH_CONTACT_EVENTS 0     /* some of these three are */
#define WITH_STIFFENING 0         /* contacts or plastic members are watched: stiffer where their margins are positive */
#define WITH_NOISY_MARGINS 0       /* some margins may have more noise than rounding of lengths */
#define WITH_MOVED_PLACES (!WITH_SMOOTH_EVENTS) /* lengths of bars follow forces that jump at some margins */
#define WITH_MOTOR_EVENTS 0       /* motors with a largest rate are watched */
#define WITH_RING_EVENTS 0        /* rings with friction are watched */
#define WITH_YIELD_EVENTS 0       /* plastic members are watched */
#define WITH_SETTLING 0           /* internal states change at events */
#define WITH_SET_STATES 0         /* some margins set internal states at their events */
#define WITH_STATIC_FRICTION 0    /* contacts stick up to a larger friction than that of slip */
#define WITH_SMOOTH_EVENTS 1      /* forces do not jump at them */
#define WITH_EVENT_FORECAST 1     /* steps become shorter where the rates of margins contradict an expected event */
#ifndef WITH_INTERNAL
#define WITH_INTERNAL 0 /* 1: the state has more than coordinates and velocities */
#endif
#ifndef METHOD_ITERATES
#define METHOD_ITERATES 0 /* 1: trials iterate, and count their evaluations */
#endif
#ifndef WITH_COLUMNS
#define WITH_COLUMNS 0 /* 1: states have derivatives of a motion behind them */
#endif
#ifndef WITH_ADJOINT
#define WITH_ADJOINT 0 /* 1: steps can be put on a tape, and gradients go backwards over it */
#endif
#define WITH_DIRECTION WITH_COLUMNS /* columns are along directions of parameters */
#define WITH_MARGIN_JUMPS (!WITH_SMOOTH_EVENTS) /* forces jump at margins of cables, with derivatives */
#define WITH_COLUMN_JUMPS 1 /* the derivatives are columns */
#define WITH_ENERGY (!WITH_FLOAT) /* steps can keep the energy */
#define WITH_DIAGONAL_MASS 1
#define WITH_RIGID_MOTION (CONFIG_N % 3 == 0) /* all nodes are free */
#define WITH_AXES_3 (CONFIG_N % 3 == 0)
#define WITH_AXES_2 0
#define WITH_RADAU_DIAGONAL_MASS 1
#define WITH_RADAU_DAMPED (CONFIG_N % 3 == 0) /* the matrix holds cables with much damping */
#define WITH_CONSTRAINTS 1 /* coordinates are redundant: a projection brings them back */
#define WITH_VELOCITY 1    /* accelerations depend on velocities */
#define WITH_MEMBERS 1     /* steps of the search for an equilibrium know the members between nodes */

#if WITH_FLOAT
typedef float real;
#else
typedef double real;
#endif

/* What functions return. */
enum {
  SCENE_OK,
  SCENE_NON_FINITE_INPUT,
  SCENE_NON_FINITE_RESULT,
  SCENE_INVALID_ARGUMENT,
  SCENE_NULL_POINTER,
  SCENE_STEP_TOO_SMALL,
  SCENE_UNSUPPORTED_MACHINE,
  SCENE_TOO_MANY_EVENTS
};

#endif
