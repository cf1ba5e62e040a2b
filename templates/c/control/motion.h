#ifndef CONTROL_MOTION_H
#define CONTROL_MOTION_H
#include "config.h"

#if WITH_POLICY
/* Inputs at the start; those that belong to no actuator keep them. */
static inline void motion_input(real time, real *input)
{
  int k;
  (void)time;
  for (k = 0; k < N_IN; ++k) {
    input[k] = START_INPUT[k];
  }
}
#else
/* Interval of rising knots, two at least, that a time lies in, and its share of the interval, 0 to 1. */
static inline int control_interval(const real *knot, int count, real time, real *share)
{
  int low = 0, high = count - 1;
  if (!(time > knot[0])) {
    *share = (real)0.0;
    return 0;
  }
  if (time >= knot[high]) {
    *share = (real)1.0;
    return high - 1;
  }
  while (high - low > 1) {
    const int middle = low + (high - low) / 2;
    if (time >= knot[middle]) {
      low = middle;
    } else {
      high = middle;
    }
  }
  *share = (time - knot[low]) / (knot[high] - knot[low]);
  return low;
}

/* Coordinates and velocities of the motion at a time: polynomials of degree 5 with the positions, velocities and
 * accelerations of both knots. Before the start and after the end the motion is at rest. */
static inline void motion_state(real time, real *state)
{
  real s;
  const int k = control_interval(MOTION_TIME, N_MOTION, time, &s);
  const real h = MOTION_TIME[k + 1] - MOTION_TIME[k];
  const real *from = MOTION_STATE + k * 4 * N_Q, *to = from + 4 * N_Q;
  const int is_moving = time >= MOTION_TIME[0] && time <= MOTION_TIME[N_MOTION - 1];
  int i;
  for (i = 0; i < N_Q; ++i) {
    const real velocity = h * from[N_Q + i], bend = h * h * from[2 * N_Q + i];
    const real gap = from[3 * N_Q + i];
    const real gain = h * to[N_Q + i] - velocity - bend, turn = h * h * to[2 * N_Q + i] - bend;
    const real c3 = (real)10.0 * gap - (real)4.0 * gain + (real)0.5 * turn;
    const real c4 = (real)-15.0 * gap + (real)7.0 * gain - turn;
    const real c5 = (real)6.0 * gap - (real)3.0 * gain + (real)0.5 * turn;
    state[i] = from[i] + s * (velocity + s * ((real)0.5 * bend + s * (c3 + s * (c4 + s * c5))));
    state[N_Q + i] = (real)0.0;
    if (is_moving) {
      const real slope = s * (bend + s * ((real)3.0 * c3 + s * ((real)4.0 * c4 + s * (real)5.0 * c5)));
      state[N_Q + i] = (velocity + slope) / h;
    }
  }
}

/* All inputs of the motion at a time: the cubic spline through the knots. */
static inline void motion_input(real time, real *input)
{
  real s;
  const int k = control_interval(MOTION_TIME, N_MOTION, time, &s);
  const real h = MOTION_TIME[k + 1] - MOTION_TIME[k];
  const real *from = MOTION_INPUT + k * 2 * N_IN, *to = from + 2 * N_IN;
  int i;
  for (i = 0; i < N_IN; ++i) {
    const real gap = to[i] - from[i], first = h * from[N_IN + i], last = h * to[N_IN + i];
    const real c2 = (real)3.0 * gap - (real)2.0 * first - last, c3 = first + last - (real)2.0 * gap;
    input[i] = from[i] + s * (first + s * (c2 + s * c3));
  }
}
#endif

#endif
