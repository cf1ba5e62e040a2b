#ifndef INTERPOLATE_H
#define INTERPOLATE_H
#include "config.h"

/* State at fraction s of a step: quintic Hermite on (q, v, a) of both ends; exact at both ends. It is the integral of
 * the cubic through (v, a), plus a defect of fifth order, which is dropped where it is rounding of the coordinates:
 * over a tiny step that would be much in the velocities. */
static inline void motion_interpolate(
    real s, real h, const real *old, const real *q1, const real *v1, const real *a1, real *out)
{
  /* What rounding leaves of the defect, squared, beside the squares of the coordinates. */
#if WITH_FLOAT
  const real rounding = (real)2e-13;
#else
  const real rounding = (real)1e-30;
#endif
  const real *q0 = old, *v0 = old + N, *a0 = old + N_STATES;
  int k;
#if WITH_INTERNAL
  /* Friction feels velocities: here the defect is rounding beside that of the largest coordinate. */
  real largest = (real)0.0;
  for (k = 0; k < N; ++k) {
    largest = q1[k] * q1[k] > largest ? q1[k] * q1[k] : largest;
  }
#endif
  for (k = 0; k < N; ++k) {
    const real b0 = h * a0[k], b1 = h * a1[k], rise = v1[k] - v0[k];
    const real c1 = (real)0.5 * b0, c2 = ((real)3.0 * rise - (real)2.0 * b0 - b1) / (real)3.0;
    const real c3 = (real)0.25 * (b0 + b1 - (real)2.0 * rise);
#if WITH_INTERNAL
    const real defect = q1[k] - q0[k] - h * (v0[k] + c1 + c2 + c3), size = (real)2.0 * largest;
#else
    const real defect = q1[k] - q0[k] - h * (v0[k] + c1 + c2 + c3), size = q1[k] * q1[k] + q0[k] * q0[k];
#endif
    const real d = defect * defect > rounding * size ? defect : (real)0.0;
    if (s >= (real)1.0) {
      out[k] = q1[k];
      out[N + k] = v1[k];
    } else {
      const real bend = s * s * ((real)10.0 + s * ((real)6.0 * s - (real)15.0));
      const real slope = (real)30.0 * s * s * ((real)1.0 - s) * ((real)1.0 - s);
      out[k] = q0[k] + s * (h * (v0[k] + s * (c1 + s * (c2 + s * c3))) + bend * d);
      out[N + k] = v0[k] + s * (b0 + s * ((real)3.0 * c2 + s * (real)4.0 * c3)) + slope * d / h;
    }
  }
#if WITH_INTERNAL
  /* Internal states and their rates stand behind velocities and accelerations: cubic Hermite. */
  for (k = N; k < N_SLOPES; ++k) {
    const real b0 = h * a0[k], b1 = h * a1[k], rise = v1[k] - v0[k];
    const real cubic = v0[k] + s * (b0 + s * ((real)3.0 * rise - (real)2.0 * b0 - b1 + s * (b0 + b1 - (real)2.0 * rise)));
    out[N + k] = s >= (real)1.0 ? v1[k] : cubic;
  }
#endif
}

#endif
