#ifndef COLLOCATION_H
#define COLLOCATION_H
#include "finite.h"
#include "radau_constants.h"
#include "sample.h"

/* Radau IIA with three stages for x' = f(t, x), x = (q, v, z), J its Jacobian at the start of the step (Hairer and
 * Wanner 1996, IV.8). Newton's method for the changes of the stages solves, after a change of variables, one system
 * (lambda - J) u = r with a real lambda and one with a complex one. With q' = v one of n equations is left,
 *   (lambda - A_v - A_q / lambda) u_v = r_v + A_q r_q / lambda,   u_q = (r_q + u_v) / lambda,
 * where A_q, A_v are the Jacobians of the acceleration; rates of internal states stand below the accelerations. The
 * real system is solved by the complex code. A pull in a live page is not in J. */
#if !WITH_FLOAT

enum {
  COLLOCATION_STAGES = 3,      /* place of the derivative at the end: that of the last stage */
  COLLOCATION_RATES = 4,       /* derivatives that are kept: of the start and of the stages */
  COLLOCATION_ERROR_ORDER = 4, /* power of the step with which the error estimate goes */
  COLLOCATION_MATRIX = 2 * N_SLOPES * N_SLOPES
};
static const double collocation_newton_share = 1e-4; /* of the tolerance, that Newton's method may leave */

/* Memory of one trial: the Jacobian; factors of the real and of the complex matrix, column by column; changes of the
 * stages; a right-hand side; evaluations of f. Complex numbers are pairs (real, imaginary). */
typedef struct {
  double jacobian[N_STATE_JACOBIAN], matrix[4 * N_SLOPES * N_SLOPES], inner[3 * N_STATES], side[2 * N_STATES];
  long long n_evaluations;
  int pivot[2 * N_SLOPES];
} collocation_memory;

/* result += (re + i im) A_q x, from the lower left part of the Jacobian. */
static inline void collocation_add_stiff(
    const collocation_memory *w, double re, double im, const double *x, double *TENSEGRITY_RESTRICT result)
{
  int j, k;
  for (j = 0; j < N; ++j) {
    const double a = re * x[2 * j] - im * x[2 * j + 1], b = re * x[2 * j + 1] + im * x[2 * j];
    for (k = scene_state_jacobian_column_start[j]; k < scene_state_jacobian_column_start[j + 1]; ++k) {
      const int row = scene_state_jacobian_row[k] - N;
      if (row >= 0) {
        result[2 * row] += a * w->jacobian[k];
        result[2 * row + 1] += b * w->jacobian[k];
      }
    }
  }
}

/* y += (re + i im) x from entry `first` to before `last`. */
static inline void collocation_add(
    int first, int last, double re, double im, const double *TENSEGRITY_RESTRICT x, double *TENSEGRITY_RESTRICT y)
{
  int k;
  for (k = first; k < last; ++k) {
    y[2 * k] += re * x[2 * k] - im * x[2 * k + 1];
    y[2 * k + 1] += re * x[2 * k + 1] + im * x[2 * k];
  }
}

/* The matrix for lambda = re + i im, and its factors, rows exchanged as `pivot` says; zero where it is singular or not
 * finite. The diagonal of the factor holds inverses. */
static inline int collocation_factor(const collocation_memory *w, double re, double im, double *matrix, int *pivot)
{
  const double size = re * re + im * im, inverse[2] = {re / size, -im / size};
  int j, k;
  for (k = 0; k < COLLOCATION_MATRIX; ++k) {
    matrix[k] = 0.0;
  }
  for (j = 0; j < N_STATES; ++j) {
    double *column = matrix + 2 * N_SLOPES * (j < N ? j : j - N);
    for (k = scene_state_jacobian_column_start[j]; k < scene_state_jacobian_column_start[j + 1]; ++k) {
      const int row = scene_state_jacobian_row[k] - N;
      if (row >= 0) {
        column[2 * row] -= (j < N ? inverse[0] : 1.0) * w->jacobian[k];
        column[2 * row + 1] -= (j < N ? inverse[1] : 0.0) * w->jacobian[k];
      }
    }
  }
  for (k = 0; k < N_SLOPES; ++k) {
    matrix[2 * k * (N_SLOPES + 1)] += re;
    matrix[2 * k * (N_SLOPES + 1) + 1] += im;
  }
  for (j = 0; j < N_SLOPES; ++j) {
    double *own = matrix + 2 * j * N_SLOPES, largest = -1.0, a, b;
    int best = j;
    for (k = j; k < N_SLOPES; ++k) {
      const double square = own[2 * k] * own[2 * k] + own[2 * k + 1] * own[2 * k + 1];
      best = square > largest ? k : best;
      largest = square > largest ? square : largest;
    }
    pivot[j] = best;
    if (!(largest > 0.0) || !(largest < INFINITY)) {
      return 0;
    }
    for (k = 0; k < 2 * N_SLOPES; ++k) { /* both parts of each entry of the two rows */
      double *entry = matrix + 2 * (k / 2) * N_SLOPES + k % 2;
      const double moved = entry[2 * j];
      entry[2 * j] = entry[2 * best];
      entry[2 * best] = moved;
    }
    a = own[2 * j] / largest;
    b = -own[2 * j + 1] / largest;
    own[2 * j] = a;
    own[2 * j + 1] = b;
    for (k = j + 1; k < N_SLOPES; ++k) {
      const double x = own[2 * k], y = own[2 * k + 1];
      own[2 * k] = a * x - b * y;
      own[2 * k + 1] = a * y + b * x;
    }
    for (k = j + 1; k < N_SLOPES; ++k) {
      double *column = matrix + 2 * k * N_SLOPES;
      if (column[2 * j] != 0.0 || column[2 * j + 1] != 0.0) {
        collocation_add(j + 1, N_SLOPES, -column[2 * j], -column[2 * j + 1], own, column);
      }
    }
  }
  return 1;
}

/* Solve (lambda - J) u = r for lambda = re + i im with these factors, in place. */
static inline void collocation_solve(
    const collocation_memory *w, double re, double im, const double *matrix, const int *pivot, double *x)
{
  const double size = re * re + im * im, a = re / size, b = -im / size;
  double *slope = x + 2 * N;
  int j, k;
  collocation_add_stiff(w, a, b, x, slope);
  for (j = 0; j < N_SLOPES; ++j) {
    for (k = 0; k < 2; ++k) {
      const double moved = slope[2 * j + k];
      slope[2 * j + k] = slope[2 * pivot[j] + k];
      slope[2 * pivot[j] + k] = moved;
    }
    collocation_add(j + 1, N_SLOPES, -slope[2 * j], -slope[2 * j + 1], matrix + 2 * j * N_SLOPES, slope);
  }
  for (j = N_SLOPES - 1; j >= 0; --j) {
    const double *own = matrix + 2 * j * N_SLOPES;
    const double y = slope[2 * j], z = slope[2 * j + 1];
    slope[2 * j] = own[2 * j] * y - own[2 * j + 1] * z;
    slope[2 * j + 1] = own[2 * j] * z + own[2 * j + 1] * y;
    collocation_add(0, j, -slope[2 * j], -slope[2 * j + 1], own, slope);
  }
  for (k = 0; k < N; ++k) {
    const double y = x[2 * k] + slope[2 * k], z = x[2 * k + 1] + slope[2 * k + 1];
    x[2 * k] = a * y - b * z;
    x[2 * k + 1] = a * z + b * y;
  }
}

/* One correction of Newton's method from the derivatives at the stages in rates[1..3]; returns its largest size over
 * the tolerance, `largest` its largest size over that of the state, INFINITY where it is not finite. */
static inline double collocation_correct(
    double h, double rtol, double atol, const double *state, double *TENSEGRITY_RESTRICT rates, collocation_memory *w,
    double *largest)
{
  double *x = rates + N_STATES, *y = x + N_STATES, *z = y + N_STATES, *side = w->side, worst = 0.0, scale = 0.0;
  int i, k;
  *largest = 0.0;
  /* What is left of x' = f at the stages, T^-1 (f - D dx / h), in which the equations of the stages come apart. */
  for (k = 0; k < N_STATES; ++k) {
    double left[3];
    for (i = 0; i < 3; ++i) {
      const double *d = radau_d[i], *inner = w->inner + k;
      left[i] = rates[(i + 1) * N_STATES + k]
          - (d[0] * inner[0] + d[1] * inner[N_STATES] + d[2] * inner[2 * N_STATES]) / h;
    }
    x[k] = radau_ti[0][0] * left[0] + radau_ti[0][1] * left[1] + radau_ti[0][2] * left[2];
    y[k] = radau_ti[1][0] * left[0] + radau_ti[1][1] * left[1] + radau_ti[1][2] * left[2];
    z[k] = -(radau_ti[2][0] * left[0] + radau_ti[2][1] * left[1] + radau_ti[2][2] * left[2]);
  }
  /* (gamma / h - J) x = left for the real eigenvalue gamma, then for the complex one. */
  for (k = 0; k < N_STATES; ++k) {
    side[2 * k] = x[k];
    side[2 * k + 1] = 0.0;
  }
  collocation_solve(w, radau_real / h, 0.0, w->matrix, w->pivot, side);
  for (k = 0; k < N_STATES; ++k) {
    x[k] = side[2 * k];
    side[2 * k] = y[k];
    side[2 * k + 1] = z[k];
  }
  collocation_solve(w, radau_re / h, radau_im / h, w->matrix + COLLOCATION_MATRIX, w->pivot + N_SLOPES, side);
  /* Back by T, and the sizes of the corrections. */
  for (i = 0; i < 3; ++i) {
    for (k = 0; k < N_STATES; ++k) {
      const double change = radau_t[i][0] * x[k] + radau_t[i][1] * side[2 * k] - radau_t[i][2] * side[2 * k + 1];
      const double size = fabs(change), part = size / (atol + rtol * fabs(state[k]));
      w->inner[i * N_STATES + k] += change;
      worst = !(part <= worst) ? part : worst;
      *largest = fmax(*largest, size);
      scale = fmax(scale, fabs(state[k]));
    }
  }
  *largest /= scale > 0.0 ? scale : 1.0;
  return worst < INFINITY ? worst : INFINITY;
}

/* Simplified Newton iteration for the changes of the stages; returns 1 if it has converged. */
static inline int collocation_newton(
    double h, double rtol, double atol, const double *state, const motion_arguments *with, const double *lost,
    double *TENSEGRITY_RESTRICT rates, double *TENSEGRITY_RESTRICT trial, collocation_memory *w)
{
  const double share =
      collocation_newton_share * fmin(1.0, sqrt((rtol > 0.0 ? rtol : atol) / radau_share_tolerance));
  double before = 0.0, trust = 1.0, largest;
  int iteration, i, k;
  for (i = 0; i < 3; ++i) {
    for (k = 0; k < N_STATES; ++k) {
      w->inner[i * N_STATES + k] = h * radau_node[i] * rates[k];
    }
  }
  for (iteration = 1; iteration <= RADAU_MOST_ITERATIONS; ++iteration) {
    double size, ratio;
    for (i = 0; i < 3; ++i) {
      for (k = 0; k < N_STATES; ++k) {
        trial[k] = state[k] + (w->inner[i * N_STATES + k] + lost[k]);
      }
#if WITH_PROFILE
      profile_set_stage(radau_node[i] * h, with->profile);
#endif
      motion_rate(trial, with, rates + (i + 1) * N_STATES);
    }
    w->n_evaluations += 3;
    size = collocation_correct(h, rtol, atol, state, rates, w, &largest);
    if (!(size < 1e100)) {
      return 0;
    }
    ratio = iteration > 1 ? size / before : 0.0;
    if (iteration > 1) {
      /* Corrections that no longer shrink, down at the rounding of the state, are as small as they get. */
      if (ratio > 0.3 && largest <= 2e-15) {
        return 1;
      }
      /* As fast as this it would still be too far off at the last iteration. */
      if (size > share
          && (ratio >= 1.0 || size * pow(ratio, RADAU_MOST_ITERATIONS - iteration) > share * (1.0 - ratio))) {
        return 0;
      }
      trust = ratio < 0.99 ? fmax(ratio, radau_least_ratio) / (1.0 - ratio) : 100.0;
    }
    if (trust * size <= share) {
      return 1;
    }
    before = size;
  }
  return 0;
}

/* Try a step: rates[0] is the derivative at `state`; fills rates[1..3], the change of the state and `trial`, and
 * returns the scaled error: how far the derivative at the start is from that of the stages, filtered by the real
 * matrix; INFINITY where Newton's method does not converge. `lost` is what rounding has taken from the state so far
 * (Kahan 1965). */
static inline double collocation_try(
    double h, double rtol, double atol, const double *state, const motion_arguments *with, const double *lost,
    double *TENSEGRITY_RESTRICT rates, double *TENSEGRITY_RESTRICT change, double *TENSEGRITY_RESTRICT trial,
    collocation_memory *w)
{
  double worst = 0.0;
  int i, k;
  w->n_evaluations = 0;
#if WITH_PROFILE
  profile_set_stage(0.0, with->profile);
#endif
  motion_state_jacobian(state, state + N, with, w->jacobian);
  if (!collocation_factor(w, radau_real / h, 0.0, w->matrix, w->pivot)
      || !collocation_factor(w, radau_re / h, radau_im / h, w->matrix + COLLOCATION_MATRIX, w->pivot + N_SLOPES)
      || !collocation_newton(h, rtol, atol, state, with, lost, rates, trial, w)) {
    return INFINITY;
  }
  /* Rates D dx / h at the stages, what the first rate differs by from the polynomial through them, and the new state. */
  for (k = 0; k < N_STATES; ++k) {
    const double *inner = w->inner + k;
    double left = rates[k];
    for (i = 0; i < 3; ++i) {
      const double *d = radau_d[i];
      const double rate = (d[0] * inner[0] + d[1] * inner[N_STATES] + d[2] * inner[2 * N_STATES]) / h;
      rates[(i + 1) * N_STATES + k] = rate;
      left -= radau_to_start[i] * rate;
    }
    w->side[2 * k] = left;
    w->side[2 * k + 1] = 0.0;
    change[k] = inner[2 * N_STATES] + lost[k];
    trial[k] = state[k] + change[k];
  }
  collocation_solve(w, radau_real / h, 0.0, w->matrix, w->pivot, w->side);
  for (k = 0; k < N_STATES; ++k) {
    worst = fmax(worst, fabs(w->side[2 * k]) / (atol + rtol * fmax(fabs(state[k]), fabs(trial[k]))));
  }
  return all_finite(trial, N_STATES) ? worst : INFINITY;
}

#endif
#endif
