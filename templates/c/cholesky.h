#ifndef CHOLESKY_H
#define CHOLESKY_H
#include "config.h"

#if !WITH_FLOAT
/* Largest absolute entry; NAN if any entry is. */
static inline double largest_entry(const double *values)
{
  double largest = 0.0;
  int k;
  for (k = 0; k < N; ++k) {
    const double size = fabs(values[k]);
    if (!(size <= largest)) {
      largest = size;
    }
    if (size != size) {
      return size;
    }
  }
  return largest;
}

/* A symmetric matrix in compressed columns, plus shift * diag(weight), row by row. */
static inline void cholesky_fill(
    const double *matrix, const int *row, const int *column_start, double shift, const double *weight, double *full)
{
  int j, k;
  for (k = 0; k < N * N; ++k) {
    full[k] = 0.0;
  }
  for (j = 0; j < N; ++j) {
    for (k = column_start[j]; k < column_start[j + 1]; ++k) {
      full[row[k] * N + j] = matrix[k];
    }
    full[j * (N + 1)] += shift * weight[j];
  }
}

/* Lower Cholesky factors in place of a symmetric matrix (n, n), of which the lower half is read. Returns whether it is
 * positive definite; *smallest is the smallest pivot reached. */
static inline int cholesky_factor(int n, double *factor, double *smallest)
{
  int i, j, k;
  *smallest = INFINITY;
  for (j = 0; j < n; ++j) {
    double *own = factor + j * n;
    const double diagonal = fabs(own[j]);
    double pivot = own[j];
    for (k = 0; k < j; ++k) {
      pivot -= own[k] * own[k];
    }
    *smallest = pivot < *smallest ? pivot : *smallest;
    /* A pivot that has cancelled down to rounding counts as zero. */
    if (!(pivot > 1e-13 * diagonal)) {
      return 0;
    }
    own[j] = sqrt(pivot);
    for (i = j + 1; i < n; ++i) {
      double *other = factor + i * n;
      double sum = other[j];
      for (k = 0; k < j; ++k) {
        sum -= other[k] * own[k];
      }
      other[j] = sum / own[j];
    }
  }
  return 1;
}

/* Solves with the factors: step = (L L^T)^-1 force, both (n,); they may be the same. */
static inline void cholesky_solve(int n, const double *factor, const double *force, double *step)
{
  int i, k;
  for (i = 0; i < n; ++i) {
    double sum = force[i];
    for (k = 0; k < i; ++k) {
      sum -= factor[i * n + k] * step[k];
    }
    step[i] = sum / factor[i * (n + 1)];
  }
  for (i = n - 1; i >= 0; --i) {
    double sum = step[i];
    for (k = i + 1; k < n; ++k) {
      sum -= factor[k * n + i] * step[k];
    }
    step[i] = sum / factor[i * (n + 1)];
  }
}

/* Sizes of the coordinates for the shift: the diagonal of the matrix, none below a thousandth of the largest. */
static inline void cholesky_weight(const double *matrix, const int *row, const int *column_start, double *weight)
{
  double largest = 0.0;
  int j, k;
  for (j = 0; j < N; ++j) {
    weight[j] = 0.0;
    for (k = column_start[j]; k < column_start[j + 1]; ++k) {
      if (row[k] == j) {
        weight[j] = fabs(matrix[k]);
      }
    }
    largest = weight[j] > largest ? weight[j] : largest;
  }
  largest = largest > 0.0 ? largest : 1.0;
  for (j = 0; j < N; ++j) {
    weight[j] = weight[j] > 1e-3 * largest ? weight[j] : 1e-3 * largest;
  }
}
#endif

#endif
