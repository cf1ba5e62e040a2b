#ifndef RADAU_STEP_H
#define RADAU_STEP_H
#include "finite.h"
#include "radau_constants.h"
#include "radau_solve.h"
#include "radau_work.h"
#if !WITH_FLOAT

/* Unit vectors from end 1 to end 0, l - rho and l' of the members with a multiplier, at (q, v). */
static inline void radau_members(
    const radau_work *run, const double *q, const double *v, double *direction, double *gap, double *rate)
{
  int b, k;
  for (b = 0; b < N_TENSIONS; ++b) {
    const int *at = radau_coordinate + 2 * AXES * b;
    double d[AXES], square = 0.0, along = 0.0, length;
    for (k = 0; k < AXES; ++k) {
      const int i = at[k], j = at[AXES + k];
      d[k] = (i < 0 ? 0.0 : q[i]) - (j < 0 ? 0.0 : q[j]) + run->offset[AXES * b + k];
      along += d[k] * ((i < 0 ? 0.0 : v[i]) - (j < 0 ? 0.0 : v[j]));
      square += d[k] * d[k];
    }
    length = sqrt(square);
    for (k = 0; k < AXES; ++k) {
      direction[AXES * b + k] = d[k] / length;
    }
    gap[b] = length - run->rest_length_now[b];
    rate[b] = along / length;
  }
}

/* f -= G^T t: the pull of the members with a multiplier. */
static inline void radau_pull(const double *direction, const double *tension, double *f)
{
  int b, k;
  for (b = 0; b < N_TENSIONS; ++b) {
    const int *at = radau_coordinate + 2 * AXES * b;
    for (k = 0; k < AXES; ++k) {
      const double part = tension[b] * direction[AXES * b + k];
      if (at[k] >= 0) {
        f[at[k]] -= part;
      }
      if (at[AXES + k] >= 0) {
        f[at[AXES + k]] += part;
      }
    }
  }
}

/* y = H x. */
static inline void radau_mass(const radau_work *run, const double *x, double *y)
{
  int k;
#if WITH_RADAU_DIAGONAL_MASS
  for (k = 0; k < N; ++k) {
    y[k] = run->mass[k] * x[k];
  }
#else
  int column;
  for (column = 0; column < N; ++column) {
    double sum = 0.0;
    for (k = scene_mass_matrix_column_start[column]; k < scene_mass_matrix_column_start[column + 1]; ++k) {
      sum += run->mass[k] * x[scene_mass_matrix_row[k]];
    }
    y[column] = sum;
  }
#endif
}

/* What stays the same during the integration: laws of the members and the mass matrix, in the order of the factors. */
static inline void radau_prepare(radau_work *run)
{
  int b, k;
  radau_laws(run->with, run->law, run->mass);
  for (b = 0; b < N_TENSIONS; ++b) {
    const double *law = run->law + (3 + AXES) * scene_radau_member[b];
    run->rest_length_now[b] = law[0];
    run->compliance[b] = law[1] > 0.0 ? 1.0 / law[1] : 0.0;
    run->lag[b] = law[1] > 0.0 ? law[2] / law[1] : 0.0;
    for (k = 0; k < AXES; ++k) {
      run->offset[AXES * b + k] = law[3 + k];
    }
  }
  for (k = 0; k < RADAU_ENTRIES; ++k) {
    run->mass_entry[k] = 0.0;
  }
  for (k = 0; k < RADAU_MASSES; ++k) {
    const int to = radau_mass_entry[k];
    if (to < 0) {
      run->mass_diagonal[-1 - to] = run->mass[k];
    } else if (to < RADAU_ENTRIES) { /* else the other half of the matrix */
      run->mass_entry[to] = run->mass[k];
    }
  }
  for (k = 0; k < 2 * N_UNKNOWNS; ++k) {
    run->spare[k] = 0.0;
  }
}

/* Enter the direction of a member into the matrix, pairs of numbers where `width` is 2. */
static inline void radau_enter(radau_work *run, const int *to, const double *direction, int width)
{
  int k;
  for (k = 0; k < 2 * AXES; ++k) {
    if (to[k] >= 0) {
      run->entry[width * to[k]] = k < AXES ? direction[k] : -direction[k - AXES];
      if (width == 2) {
        run->entry[2 * to[k] + 1] = 0.0;
      }
    }
  }
}

#if WITH_RADAU_DAMPED
/* Directions and laws of the damped cables at (q, v); those that do not pull have none. */
static inline void radau_find_damped(radau_work *run, const double *q, const double *v)
{
  int b, k;
#if WITH_PROFILE
  const double *laws = run->law_later;
  radau_laws(run->with, run->law_later, run->mass_later);
#else
  const double *laws = run->law;
#endif
  for (b = 0; b < N_DAMPED; ++b) {
    const int *at = radau_coordinate + 2 * AXES * (N_TENSIONS + b);
    const double *law = laws + (3 + AXES) * radau_damped_member[b];
    double *d = run->damped_direction + AXES * b, square = 0.0, along = 0.0, length;
    int pulls;
    for (k = 0; k < AXES; ++k) {
      const int i = at[k], j = at[AXES + k];
      d[k] = (i < 0 ? 0.0 : q[i]) - (j < 0 ? 0.0 : q[j]) + law[3 + k];
      along += d[k] * ((i < 0 ? 0.0 : v[i]) - (j < 0 ? 0.0 : v[j]));
      square += d[k] * d[k];
    }
    /* t = mu (l - rho) + c l' > 0, and l > rho: the cable pulls; lag: c / mu. */
    length = sqrt(square);
    pulls = length > law[0] && law[1] * (length - law[0]) + law[2] * along / length > 0.0;
    run->damped_stiffness[b] = pulls ? law[1] : 0.0;
    run->damped_lag[b] = pulls ? law[2] / law[1] : 0.0;
    for (k = 0; k < AXES; ++k) {
      d[k] = pulls ? d[k] / length : 0.0;
    }
  }
}

/* Enter the damped cables for s = re + i im: eliminated, their rows add mu (1 + lag s) g g^T, g: a direction. With s = 0
 * they are left out. */
static inline void radau_enter_damped(radau_work *run, double re, double im, int width)
{
  static const double nothing[AXES] = {0.0};
  int b;
  for (b = 0; b < N_DAMPED; ++b) {
    const int row = radau_elimination_row[N + N_TENSIONS + b], *to = radau_direction_entry + 2 * AXES * (N_TENSIONS + b);
    const double u = 1.0 + run->damped_lag[b] * re, w = run->damped_lag[b] * im;
    const double size = run->damped_stiffness[b] * (u * u + w * w);
    const int is_in = re > 0.0 && size > 0.0;
    radau_enter(run, to, is_in ? run->damped_direction + AXES * b : nothing, width);
    run->diagonal[width * row] = is_in ? -u / size : -1.0;
    if (width == 2) {
      run->diagonal[2 * row + 1] = is_in ? w / size : 0.0;
    }
  }
}

#endif
/* Factors of [square H, G^T; G, -c] at `direction`, c: compliance; damped cables are entered for s. */
static inline int radau_factor_real(
    radau_work *run, double s, double square, const double *compliance, double least, double *factor, double *inverse)
{
  int b, k;
  for (k = 0; k < RADAU_ENTRIES; ++k) {
    run->entry[k] = square * run->mass_entry[k];
  }
  for (k = 0; k < N; ++k) {
    run->diagonal[radau_elimination_row[k]] = square * run->mass_diagonal[radau_elimination_row[k]];
  }
  for (b = 0; b < N_TENSIONS; ++b) {
    radau_enter(run, radau_direction_entry + 2 * AXES * b, run->direction + AXES * b, 1);
    run->diagonal[radau_elimination_row[N + b]] = -compliance[b];
  }
#if WITH_RADAU_DAMPED
  radau_enter_damped(run, s, 0.0, 1);
#else
  (void)s;
#endif
  return radau_factor(run->entry, run->diagonal, least, factor, inverse, run->spare);
}

/* Factors of both matrices of a step of length h: s = radau_real / h and s = (radau_re + i radau_im) / h. */
static inline int radau_factor_step(radau_work *run, double h)
{
  const double a = radau_re / h, c = radau_im / h, re = a * a - c * c, im = 2.0 * a * c;
  int b, k;
  ++run->count[3];
  /* s^2 H, G and -1 / (mu (1 + lag s)) of [s^2 H, G^T; G, -c] for the complex s */
  for (k = 0; k < RADAU_ENTRIES; ++k) {
    run->entry[2 * k] = re * run->mass_entry[k];
    run->entry[2 * k + 1] = im * run->mass_entry[k];
  }
  for (k = 0; k < N; ++k) {
    run->diagonal[2 * radau_elimination_row[k]] = re * run->mass_diagonal[radau_elimination_row[k]];
    run->diagonal[2 * radau_elimination_row[k] + 1] = im * run->mass_diagonal[radau_elimination_row[k]];
  }
  for (b = 0; b < N_TENSIONS; ++b) {
    const int row = radau_elimination_row[N + b];
    const double u = 1.0 + run->lag[b] * a, w = run->lag[b] * c, share = run->compliance[b] / (u * u + w * w);
    radau_enter(run, radau_direction_entry + 2 * AXES * b, run->direction + AXES * b, 2);
    run->diagonal[2 * row] = -share * u;
    run->diagonal[2 * row + 1] = share * w;
  }
#if WITH_RADAU_DAMPED
  radau_enter_damped(run, a, c, 2);
#endif
  radau_complex_factor(run->entry, run->diagonal, run->complex_factor, run->complex_inverse, run->spare);
  for (b = 0; b < N_TENSIONS; ++b) {
    run->shift[b] = run->compliance[b] / (1.0 + run->lag[b] * radau_real / h);
  }
  return radau_factor_real(
      run, radau_real / h, radau_real * radau_real / (h * h), run->shift, 0.0, run->real_factor, run->real_inverse);
}

/* Velocities and accelerations of the stages from their increments. */
static inline void radau_differentiate(radau_work *run, double h, const double *velocity)
{
  const double *TENSEGRITY_RESTRICT increment = run->increment;
  double *TENSEGRITY_RESTRICT rate = run->stage_velocity, *TENSEGRITY_RESTRICT bend = run->stage_acceleration;
  const double s = 1.0 / h;
  int i, k;
  for (i = 0; i < 3; ++i) {
    const double *d = radau_d[i], *d2 = radau_d2[i], d1 = radau_d1[i];
    for (k = 0; k < N; ++k) {
      const double a = increment[k], b = increment[N + k], c = increment[2 * N + k];
      rate[i * N + k] = s * (d[0] * a + d[1] * b + d[2] * c);
      bend[i * N + k] = s * (s * (d2[0] * a + d2[1] * b + d2[2] * c) - d1 * velocity[k]);
    }
  }
}

/* What the equations of motion and of the members leave over at the stages. */
static inline void radau_residual(radau_work *run, double h, const double *state)
{
  int i, k, b;
  radau_differentiate(run, h, state + N);
  for (i = 0; i < 3; ++i) {
    const double *v = run->stage_velocity + i * N, *tension = run->stage_tension + i * N_TENSIONS;
    double *left = run->residual + i * N_UNKNOWNS, *gap = left + N;
    for (k = 0; k < N; ++k) {
      run->point[k] = state[k] + run->increment[i * N + k];
    }
#if WITH_PROFILE
    profile_set_stage(radau_node[i] * h, run->with->profile);
#endif
    radau_force(run->point, v, run->with, run->applied);
    radau_members(run, run->point, v, run->turned, gap, run->stage_rate);
    radau_pull(run->turned, tension, run->applied);
    radau_mass(run, run->stage_acceleration + i * N, left);
    /* f - H q'' and t / mu - (l - rho) - lag l' */
    for (k = 0; k < N; ++k) {
      left[k] = run->applied[k] - left[k];
    }
    for (b = 0; b < N_TENSIONS; ++b) {
      gap[b] = run->compliance[b] * tension[b] - gap[b] - run->lag[b] * run->stage_rate[b];
    }
    for (; b < N_ROWS; ++b) {
      gap[b] = 0.0;
    }
  }
  run->count[5] += 3;
}

/* The largest of N numbers by their size, and by their size times weight; INFINITY where one is not finite. Eight at a
 * time, so that none waits for the last. */
static inline void radau_measure(const double *value, const double *weight, double *plain, double *weighted)
{
  double a[8] = {0.0}, b[8] = {0.0}, lost[8] = {0.0};
  int first, j, k;
  for (first = 0; first + 8 <= N; first += 8) {
    for (j = 0; j < 8; ++j) {
      const double size = fabs(value[first + j]), part = size * weight[first + j];
      a[j] = size > a[j] ? size : a[j];
      b[j] = part > b[j] ? part : b[j];
      lost[j] += part - part;
    }
  }
  for (k = first; k < N; ++k) {
    const double size = fabs(value[k]), part = size * weight[k];
    a[0] = size > a[0] ? size : a[0];
    b[0] = part > b[0] ? part : b[0];
    lost[0] += part - part;
  }
  for (j = 0; j < 8; ++j) {
    *plain = fmax(*plain, a[j]);
    *weighted = lost[j] == 0.0 ? fmax(*weighted, b[j]) : INFINITY;
  }
}

/* Weights of corrections in a step of length h from `state`, and its largest coordinate. */
static inline void radau_weigh(radau_work *run, double h, const double *state)
{
  const double *v = state + N, part = h / radau_real;
  double worst = 0.0;
  int k;
  for (k = 0; k < N; ++k) {
    const double sq = run->atol + run->rtol * fabs(state[k]), sv = (run->atol + run->rtol * fabs(v[k])) * part;
    run->weight[k] = 1.0 / (sq < sv ? sq : sv);
  }
  run->kept[RADAU_KEPT_LARGEST_COORDINATE] = 0.0;
  radau_measure(state, run->weight, run->kept + 6, &worst);
}

/* Sides of the real and of the complex system from the residual, in the order of elimination. */
static inline void radau_transform(radau_work *run, double h)
{
  const double a = radau_re / h, c = radau_im / h;
  int k, b;
  for (k = 0; k < N_UNKNOWNS; ++k) {
    const double x = run->residual[k], y = run->residual[N_UNKNOWNS + k], z = run->residual[2 * N_UNKNOWNS + k];
    const int to = radau_elimination_row[k];
    run->real_side[to] = radau_ti[0][0] * x + radau_ti[0][1] * y + radau_ti[0][2] * z;
    run->complex_side[2 * to] = radau_ti[1][0] * x + radau_ti[1][1] * y + radau_ti[1][2] * z;
    run->complex_side[2 * to + 1] = -(radau_ti[2][0] * x + radau_ti[2][1] * y + radau_ti[2][2] * z);
  }
  for (b = 0; b < N_TENSIONS; ++b) {
    const int to = radau_elimination_row[N + b];
    const double u = 1.0 + run->lag[b] * a, w = run->lag[b] * c, size = u * u + w * w;
    const double re = run->complex_side[2 * to], im = run->complex_side[2 * to + 1];
    if (run->lag[b] > 0.0) {
      run->real_side[to] /= 1.0 + run->lag[b] * radau_real / h;
      run->complex_side[2 * to] = (re * u + im * w) / size;
      run->complex_side[2 * to + 1] = (im * u - re * w) / size;
    }
  }
}

/* One Newton correction from the residual, which it overwrites; returns its largest weighted size. */
static inline double radau_correct(radau_work *run, double h)
{
  double *change = run->residual, worst = 0.0;
  int i, k;
  radau_transform(run, h);
  radau_solve(run->real_factor, run->real_inverse, run->real_side);
  radau_complex_solve(run->complex_factor, run->complex_inverse, run->complex_side);
  for (k = 0; k < N_UNKNOWNS; ++k) {
    const int from = radau_elimination_row[k];
    const double x = run->real_side[from], y = run->complex_side[2 * from], z = -run->complex_side[2 * from + 1];
    for (i = 0; i < 3; ++i) {
      change[i * N_UNKNOWNS + k] = radau_t[i][0] * x + radau_t[i][1] * y + radau_t[i][2] * z;
    }
  }
  run->kept[RADAU_KEPT_LARGEST_CORRECTION] = 0.0;
  for (i = 0; i < 3; ++i) {
    radau_measure(change + i * N_UNKNOWNS, run->weight, run->kept + 5, &worst);
    for (k = 0; k < N; ++k) {
      run->increment[i * N + k] += change[i * N_UNKNOWNS + k];
    }
    for (k = 0; k < N_TENSIONS; ++k) {
      run->stage_tension[i * N_TENSIONS + k] += change[i * N_UNKNOWNS + N + k];
    }
  }
  run->count[4] += worst < INFINITY;
  return worst;
}

/* First guess of the stages: the polynomials of the step before, carried on, or uniform motion. */
static inline void radau_predict(radau_work *run, double h, const double *state)
{
  const double before = run->kept[RADAU_KEPT_STEP], far = before > 0.0 ? h / before : 0.0;
  int i, j, k;
  for (i = 0; i < 3; ++i) {
    const double s = 1.0 + radau_node[i] * far;
    double q[3], t[3];
    for (j = 0; j < 3; ++j) {
      const double c = radau_node[j], d = radau_node[(j + 1) % 3], e = radau_node[(j + 2) % 3];
      t[j] = (s - d) * (s - e) / ((c - d) * (c - e));
      q[j] = t[j] * s / c;
    }
    for (k = 0; k < N; ++k) {
      const double *old = run->old_increment + k;
      run->increment[i * N + k] = before > 0.0
          ? q[0] * old[0] + q[1] * old[N] + q[2] * old[2 * N] - old[2 * N]
          : h * radau_node[i] * (state[N + k] + 0.5 * h * radau_node[i] * run->acceleration[k]);
    }
    for (k = 0; k < N_TENSIONS; ++k) {
      const double *old = run->old_tension + k;
      run->stage_tension[i * N_TENSIONS + k] =
          before > 0.0 ? t[0] * old[0] + t[1] * old[N_TENSIONS] + t[2] * old[2 * N_TENSIONS] : run->tension[k];
    }
  }
}

/* Simplified Newton iteration for the stages; returns 1 if it has converged. */
static inline int radau_newton(radau_work *run, double h, const double *state)
{
  double before = 0.0, trust = 1.0;
  int iteration;
  radau_predict(run, h, state);
  for (iteration = 1; iteration <= RADAU_MOST_ITERATIONS; ++iteration) {
    double size;
    radau_residual(run, h, state);
    size = radau_correct(run, h);
    if (!(size < 1e100)) {
      return 0;
    }
    if (iteration > 1) {
      const double ratio = size / before;
      /* Corrections that no longer shrink, down at the rounding of coordinates, are as small as they get. */
      if (ratio > 0.3 && run->kept[RADAU_KEPT_LARGEST_CORRECTION] <= 2e-15 * run->kept[RADAU_KEPT_LARGEST_COORDINATE]) {
        run->kept[RADAU_KEPT_ITERATIONS] = (double)iteration;
        return 1;
      }
      /* As fast as this it would still be too far off at the last iteration. */
      if (size > run->share
          && (ratio >= 1.0 || size * pow(ratio, RADAU_MOST_ITERATIONS - iteration) > run->share * (1.0 - ratio))) {
        return 0;
      }
      /* Two corrections overrate the pace: what the matrix leaves out, cables and turning, shows only in later ones. */
      trust = ratio < 0.99 ? fmax(ratio, radau_least_ratio) / (1.0 - ratio) : 100.0;
    }
    if (trust * size <= run->share) {
      run->kept[RADAU_KEPT_ITERATIONS] = (double)iteration;
      return 1;
    }
    before = size;
  }
  return 0;
}

/* Solve for real_side by factors that leave the damped cables out. */
static inline void radau_solve_smooth(radau_work *run, const double *factor, const double *inverse)
{
  int b;
  for (b = N_TENSIONS; b < N_ROWS; ++b) {
    run->real_side[radau_elimination_row[N + b]] = 0.0;
  }
  radau_solve(factor, inverse, run->real_side);
}

/* How an error of the state counts: over atol + rtol |x|. Overwrites the weights of the step. */
static inline double radau_norm(
    radau_work *run, const double *q, const double *v, const double *state, const double *trial)
{
  double largest = 0.0, worst = 0.0;
  int i, k;
  for (i = 0; i < 2; ++i) {
    for (k = 0; k < N; ++k) {
      const double before = fabs(state[i * N + k]), after = fabs(trial[i * N + k]);
      run->weight[k] = 1.0 / (run->atol + run->rtol * (before > after ? before : after));
    }
    radau_measure(i == 0 ? q : v, run->weight, &largest, &worst);
  }
  return worst;
}

/* Estimated error of the step to `trial`: what velocities and accelerations at its start differ by from those that
 * the stages say, filtered by the real matrix (order 3); along rigid members velocities are corrected anyway. */
static inline double radau_error(radau_work *run, double h, const double *state, const double *trial)
{
  const double s = radau_real / h;
  double *eq = run->point, *ev = run->applied;
  int k, b;
  /* H (a0 - a of the stages + s (v0 - v of the stages)), which the real matrix makes a displacement */
  for (k = 0; k < N; ++k) {
    const double *v = run->stage_velocity + k, *a = run->stage_acceleration + k;
    ev[k] = run->velocity[k] - radau_to_start[0] * v[0] - radau_to_start[1] * v[N] - radau_to_start[2] * v[2 * N];
    eq[k] = run->acceleration[k] - radau_to_start[0] * a[0] - radau_to_start[1] * a[N]
        - radau_to_start[2] * a[2 * N] + s * ev[k];
  }
  radau_mass(run, eq, run->residual);
  for (k = 0; k < N_UNKNOWNS; ++k) {
    run->real_side[radau_elimination_row[k]] = k < N ? run->residual[k] : 0.0;
  }
  radau_solve(run->real_factor, run->real_inverse, run->real_side);
  for (k = 0; k < N; ++k) {
    eq[k] = run->real_side[radau_elimination_row[k]];
    ev[k] = s * eq[k] - ev[k];
  }
  /* Take the velocity along rigid members out of the error. */
  for (b = 0; b < N_TENSIONS; ++b) {
    const int *at = radau_coordinate + 2 * AXES * b;
    double along = 0.0;
    for (k = 0; k < AXES; ++k) {
      const int i = at[k], j = at[AXES + k];
      along += run->direction[AXES * b + k] * ((i < 0 ? 0.0 : ev[i]) - (j < 0 ? 0.0 : ev[j]));
    }
    run->real_side[radau_elimination_row[N + b]] = -along;
  }
  for (k = 0; k < N; ++k) {
    run->real_side[radau_elimination_row[k]] = 0.0;
  }
  if (run->kept[RADAU_KEPT_HAS_QUIET_FACTORS] > 0.0) {
    radau_solve_smooth(run, run->quiet_factor, run->quiet_inverse);
  } else {
    radau_solve_smooth(run, run->smooth_factor, run->smooth_inverse);
  }
  for (k = 0; k < N; ++k) {
    ev[k] += run->real_side[radau_elimination_row[k]];
  }
  return radau_norm(run, eq, ev, state, trial);
}

/* Factors of [H, G^T; G, -c] at (q, v), where c is next to nothing for members that vibrate faster than a step of
 * length h resolves, and next to infinite for the others; and of the same with c = 0 for those as well whose vibration
 * is too small to matter, by which errors are judged. */
static inline int radau_factor_smooth(radau_work *run, double h, const double *q, const double *v)
{
  int k, b, differs = 0, is_good;
  radau_members(run, q, v, run->direction, run->gap, run->rate);
  for (b = 0; b < N_TENSIONS; ++b) {
    const int *at = radau_coordinate + 2 * AXES * b;
    const double s = 1.0 + run->lag[b] * radau_real / h;
    double mobility = 0.0, ratio;
    for (k = 0; k < AXES; ++k) {
      const double part = run->direction[AXES * b + k] * run->direction[AXES * b + k];
      mobility += (at[k] < 0 ? 0.0 : part / run->mass_diagonal[radau_elimination_row[at[k]]]);
      mobility += (at[AXES + k] < 0 ? 0.0 : part / run->mass_diagonal[radau_elimination_row[at[AXES + k]]]);
    }
    /* (period of the member over that which the step resolves)^2, to the fourth power the weight of its own values */
    ratio = run->compliance[b] * s * s * radau_resolved / (mobility * h * h);
    ratio *= ratio;
    run->shift[b] = mobility * fmin(ratio * ratio, 1e100);
    run->mobility[b] = mobility;
    differs = differs || (run->is_quiet[b] > 0.0 && ratio > 1e-4);
  }
  ++run->count[3];
  is_good = radau_factor_real(run, 0.0, 1.0, run->shift, radau_least_pivot, run->smooth_factor, run->smooth_inverse);
  run->kept[RADAU_KEPT_HAS_QUIET_FACTORS] = differs ? 1.0 : 0.0;
  if (differs) {
    for (b = 0; b < N_TENSIONS; ++b) {
      run->shift[b] = run->is_quiet[b] > 0.0 ? 0.0 : run->shift[b];
    }
    ++run->count[3];
    is_good = radau_factor_real(run, 0.0, 1.0, run->shift, radau_least_pivot, run->quiet_factor, run->quiet_inverse)
        && is_good;
  }
  return is_good;
}

/* Velocity, acceleration and tensions at (q, v, tension), with the differentiated equations of the members in place
 * of what stages of low order say: l' = t' / mu, l'' = t'' / mu. Only for members that vibrate faster than the
 * step h resolves; the others keep their own values. slope, curvature (multipliers,): t', t''. */
static inline int radau_smooth(
    radau_work *run, double h, const double *q, const double *v, const double *tension, const double *slope,
    const double *curvature)
{
  const int is_good = radau_factor_smooth(run, h, q, v);
  int k, b;
  /* Velocities: the least change, by the masses, after which l' = t' / mu - lag t'' / mu. */
  for (b = 0; b < N_TENSIONS; ++b) {
    run->real_side[radau_elimination_row[N + b]] = run->compliance[b] * (slope[b] - run->lag[b] * curvature[b]) - run->rate[b];
  }
  for (k = 0; k < N; ++k) {
    run->real_side[radau_elimination_row[k]] = 0.0;
  }
  radau_solve_smooth(run, run->smooth_factor, run->smooth_inverse);
  for (k = 0; k < N; ++k) {
    run->velocity[k] = v[k] + run->real_side[radau_elimination_row[k]];
  }
  /* Accelerations and tensions: H a + G^T dt = f, with G a = t'' / mu - (w^2 - l'^2) / l, w: relative velocity. */
  radau_force(q, run->velocity, run->with, run->applied);
  ++run->count[5];
  radau_pull(run->direction, tension, run->applied);
  for (k = 0; k < N; ++k) {
    run->real_side[radau_elimination_row[k]] = run->applied[k];
  }
  for (b = 0; b < N_TENSIONS; ++b) {
    const int *at = radau_coordinate + 2 * AXES * b;
    double along = 0.0, square = 0.0, length = run->gap[b] + run->rest_length_now[b];
    for (k = 0; k < AXES; ++k) {
      const double *w = run->velocity;
      const double part = (at[k] < 0 ? 0.0 : w[at[k]]) - (at[AXES + k] < 0 ? 0.0 : w[at[AXES + k]]);
      along += run->direction[AXES * b + k] * part;
      square += part * part;
    }
    run->real_side[radau_elimination_row[N + b]] = run->compliance[b] * curvature[b] - (square - along * along) / length;
  }
  radau_solve_smooth(run, run->smooth_factor, run->smooth_inverse);
  for (k = 0; k < N; ++k) {
    run->acceleration[k] = run->real_side[radau_elimination_row[k]];
  }
  for (b = 0; b < N_TENSIONS; ++b) {
    run->tension[b] = tension[b] + run->real_side[radau_elimination_row[N + b]];
  }
  return is_good && all_finite(run->acceleration, N) && all_finite(run->velocity, N)
      && all_finite(run->tension, N_TENSIONS);
}

#endif
#endif
