#ifndef RADAU_SOLVE_H
#define RADAU_SOLVE_H
#include "radau_config.h"
#if !WITH_FLOAT

/* Linear systems of the integrator radau: sparse factors L D L^T, real and complex, and solutions with them. */

/* L D L^T of the matrix with these entries and this diagonal, both in the order of elimination; `inverse` becomes
 * 1 / D, spare is zero before and after. Rows of multipliers of which elimination leaves no more than `least` of the
 * diagonal repeat those before them: their 1 / D becomes 0, and so does the multiplier. Returns 0 unless every other
 * pivot has the sign of its diagonal. */
static inline int radau_factor(
    const double *entry, const double *diagonal, double least, double *factor, double *inverse, double *spare)
{
  int row, k, m, is_good = 1;
  for (row = 0; row < N_UNKNOWNS; ++row) {
    double pivot = diagonal[row], lowest = pivot;
    for (k = radau_entry_start[row]; k < radau_entry_start[row + 1]; ++k) {
      spare[radau_entry_column[k]] = entry[k];
    }
    for (k = radau_factor_start[row]; k < radau_factor_start[row + 1]; ++k) {
      const int column = radau_factor_column[k];
      const double value = spare[column];
      spare[column] = 0.0;
      for (m = radau_update_start[k]; m < radau_update_start[k + 1]; ++m) {
        spare[radau_update_row[m]] -= factor[radau_update_entry[m]] * value;
      }
      factor[k] = value * inverse[column];
      pivot -= factor[k] * value;
      lowest = pivot < lowest ? pivot : lowest;
    }
    if (diagonal[row] <= 0.0 && least > 0.0 && pivot > least * lowest) {
      inverse[row] = 0.0;
    } else {
      is_good = is_good && (diagonal[row] > 0.0 ? pivot > 0.0 : pivot < 0.0);
      inverse[row] = 1.0 / pivot;
    }
  }
  return is_good;
}

/* Solve L D L^T x = b in place, in the order of elimination. */
static inline void radau_solve(const double *factor, const double *inverse, double *x)
{
  int i, k;
  for (i = 0; i < RADAU_ROWS; ++i) {
    const int row = radau_row[i];
    double sum = x[row];
    for (k = radau_factor_start[row]; k < radau_factor_start[row + 1]; ++k) {
      sum -= factor[k] * x[radau_factor_column[k]];
    }
    x[row] = sum;
  }
  for (k = 0; k < N_UNKNOWNS; ++k) {
    x[k] *= inverse[k];
  }
  for (i = RADAU_ROWS - 1; i >= 0; --i) {
    const int row = radau_row[i];
    const double value = x[row];
    for (k = radau_factor_start[row]; k < radau_factor_start[row + 1]; ++k) {
      x[radau_factor_column[k]] -= factor[k] * value;
    }
  }
}

/* L D L^T of a complex symmetric matrix, with pairs (real, imaginary); as radau_factor. */
static inline void radau_complex_factor(
    const double *entry, const double *diagonal, double *factor, double *inverse, double *spare)
{
  int row, k, m;
  for (row = 0; row < N_UNKNOWNS; ++row) {
    double re = diagonal[2 * row], im = diagonal[2 * row + 1], size;
    for (k = radau_entry_start[row]; k < radau_entry_start[row + 1]; ++k) {
      spare[2 * radau_entry_column[k]] = entry[2 * k];
      spare[2 * radau_entry_column[k] + 1] = entry[2 * k + 1];
    }
    /* l_rk = (a_rk - sum_m l_rm d_m l_km) / d_k; what is left of the diagonal: d_r = a_rr - sum_k l_rk^2 d_k */
    for (k = radau_factor_start[row]; k < radau_factor_start[row + 1]; ++k) {
      const int column = radau_factor_column[k];
      const double a = spare[2 * column], b = spare[2 * column + 1];
      spare[2 * column] = 0.0;
      spare[2 * column + 1] = 0.0;
      for (m = radau_update_start[k]; m < radau_update_start[k + 1]; ++m) {
        const double *l = factor + 2 * radau_update_entry[m];
        spare[2 * radau_update_row[m]] -= l[0] * a - l[1] * b;
        spare[2 * radau_update_row[m] + 1] -= l[0] * b + l[1] * a;
      }
      factor[2 * k] = a * inverse[2 * column] - b * inverse[2 * column + 1];
      factor[2 * k + 1] = a * inverse[2 * column + 1] + b * inverse[2 * column];
      re -= factor[2 * k] * a - factor[2 * k + 1] * b;
      im -= factor[2 * k] * b + factor[2 * k + 1] * a;
    }
    /* 1 / (re + i im) */
    size = 1.0 / (re * re + im * im);
    inverse[2 * row] = re * size;
    inverse[2 * row + 1] = -im * size;
  }
}

/* Solve L D L^T x = b in place for complex factors, with pairs (real, imaginary). */
static inline void radau_complex_solve(const double *factor, const double *inverse, double *x)
{
  int i, k;
  /* L y = b, y = D^-1 y, L^T x = y */
  for (i = 0; i < RADAU_ROWS; ++i) {
    const int row = radau_row[i];
    double re = x[2 * row], im = x[2 * row + 1];
    for (k = radau_factor_start[row]; k < radau_factor_start[row + 1]; ++k) {
      const double *l = factor + 2 * k, *y = x + 2 * radau_factor_column[k];
      re -= l[0] * y[0] - l[1] * y[1];
      im -= l[0] * y[1] + l[1] * y[0];
    }
    x[2 * row] = re;
    x[2 * row + 1] = im;
  }
  for (k = 0; k < N_UNKNOWNS; ++k) {
    const double re = x[2 * k], im = x[2 * k + 1];
    x[2 * k] = re * inverse[2 * k] - im * inverse[2 * k + 1];
    x[2 * k + 1] = re * inverse[2 * k + 1] + im * inverse[2 * k];
  }
  for (i = RADAU_ROWS - 1; i >= 0; --i) {
    const int row = radau_row[i];
    const double re = x[2 * row], im = x[2 * row + 1];
    for (k = radau_factor_start[row]; k < radau_factor_start[row + 1]; ++k) {
      const double *l = factor + 2 * k;
      double *y = x + 2 * radau_factor_column[k];
      y[0] -= l[0] * re - l[1] * im;
      y[1] -= l[0] * im + l[1] * re;
    }
  }
}

#endif
#endif
