#ifndef RUN_H
#define RUN_H
#include "settings.h"

#if WITH_EVENTS
/* Kinds of events: a cable that goes slack or taut, two bars that touch or part, a condition of the caller. */
enum {
  SCENE_EVENT_CABLE = 1,
  SCENE_EVENT_CONTACT = 2,
#if WITH_SWITCH_EVENTS
  SCENE_EVENT_SWITCH = 8, /* the slope of a member's law changes */
#endif
#if WITH_COLLISION_EVENTS
  SCENE_EVENT_COLLISION = 64, /* two bars begin to press each other or part */
#endif
#if WITH_GROUND_EVENTS
  SCENE_EVENT_GROUND = 16, /* a node touches the ground or leaves it */
#endif
#if WITH_STICK_EVENTS
  SCENE_EVENT_STICK = 32, /* a contact with the ground sticks or slips */
#endif
#if WITH_MOTOR_EVENTS
  SCENE_EVENT_MOTOR = 256, /* the rate of a motor begins or ends to be limited */
#endif
#if WITH_RING_EVENTS
  SCENE_EVENT_RING = 512, /* a cable sticks at a ring with friction or slips; which: the number of the ring */
#endif
#if WITH_YIELD_EVENTS
  SCENE_EVENT_YIELD = 128, /* a plastic member begins to flow or ends; which: twice its number among these, + 1 pushed */
#endif
  SCENE_EVENT_CONDITION = 4
};

/* One event. which: the member, the pair of bars or 0; direction: 1 where the margin rises through zero (taut,
 * apart, condition positive), -1 where it falls. */
typedef struct {
  double time;
  int kind;
  int which;
  int direction;
} scene_event;

#endif
#if WITH_PROFILE
/* Arguments that change with time: polynomials of time, piece by piece. On piece k, from time[k] to time[k + 1],
 * number place[j] is the sum over i of coefficient[(k * (degree + 1) + i) * n_values + j] * (t - time[k])^i. */
typedef struct {
  long long n_pieces;
  int degree;
  int n_values;              /* numbers that change; the others stay as they are given */
  const int *place;          /* (n_values,): SCENE_PLACE_... of an argument and the index of a number in it */
  const double *time;        /* (n_pieces + 1,) [s], rising; a run lies within */
  const double *coefficient; /* (n_pieces, degree + 1, n_values) */
  const int *is_kink;        /* (n_pieces + 1,): whether a value or its slope jumps there; NULL: everywhere */
} scene_profile;

#endif
/* How a run with error control goes; all zero before its first call. */
typedef struct {
  long long n_accepted;    /* accepted steps */
  long long n_rejected;    /* rejected steps */
  long long n_evaluations; /* of the accelerations */
#if WITH_EVENTS
  int watch; /* sum of the kinds of events at which steps end; 0: none */
  int stop;  /* sum of the kinds that end the run, just after the event */
  double (*condition)(double time, const double *coordinate, const double *velocity, void *data);
  void *condition_data;
  scene_event *event; /* (most_events,), NULL: not stored */
  long long most_events;
  long long n_events; /* number of events, also beyond most_events */
  int is_stopped;     /* 1 where an event of `stop` has ended the last call */
#endif
#if WITH_PROFILE
  const scene_profile *profile; /* arguments that change with time; steps end at its kinks; NULL: none */
#endif
#if WITH_ADJOINT
  double *tape; /* (most_taped, SCENE_METHOD_TAPE): steps, for the adjoint; a call ends where it is full; NULL: none */
  long long most_taped;
  long long n_taped;
#endif
#if WITH_ENERGY
  int keeps_energy; /* 1: steps end at the energy of the start */
#endif
  int is_started; /* internal, from here on: kept between calls */
  int may_grow;   /* whether the next step may be longer: no, right after a rejection */
#if WITH_ENERGY
  double energy; /* at the start [J] */
#endif
#if WITH_EVENTS
  int n_rapid_events;      /* events in a row, each within a thousandth of a step of the previous one */
  int n_close_events;      /* events in a row, each within a step of the previous one */
  int n_trials;            /* trials since `progress_time` */
  double progress_time;    /* the last time that was a thousandth of a step after the one before [s] */
  double time_to_event;    /* from the end of the last step, which is just before an event [s]; 0: to none */
  double usual_step;       /* length of the last step that no event shortened [s] */
  double step_limit;       /* longest step after many events [s]; 0: none */
  double step_to_event;    /* length of the next step, which ends just before an event [s]; 0: before none */
  double time_behind_step; /* from that end to the event [s] */
  double noise_factor;     /* of the rounding by which a margin must pass zero to count */
  double last_event;       /* time of the last event [s] */
#endif
  double reached; /* where the last call ended [s] */
  double last_error; /* of the last step, over what is allowed; 0: of none */
  int follows_two_errors; /* set by the caller: 1: explicit steps follow two errors, so that fewer fail */
} scene_run;

#endif
