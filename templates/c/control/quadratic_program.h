#ifndef QUADRATIC_PROGRAM_H
#define QUADRATIC_PROGRAM_H
#include "daqp_settings.h"
#include "distribution_memory.h"

/* Least |A x - b|^2 within bounds of x and of some sums of its entries. A is a matrix on top of a multiple of the unit
 * matrix. With A = Q R and y = R x DAQP finds the least |y - Q^T b|^2; A^T A, whose rounding errors are larger, is not
 * formed. Triangular matrices are stored row by row, from the diagonal on. */

#if WITH_FLOAT
static inline real program_size(real value) { return fabsf(value); }
#else
static inline real program_size(real value) { return fabs(value); }
#endif

/* What binds DAQP to the memory. */
typedef struct {
  DAQPWorkspace work;
  DAQPSettings settings;
  DAQPProblem problem;
} program_solver;

/* First entry of a row of a triangle, less its column. */
static inline int program_row(int i) { return i * N_U - i * (i + 1) / 2; }

/* R and Q of the matrix with `bottom` > 0 times the unit matrix below it. Reflection k makes column k zero below row k,
 * where only the next N_ROWS rows have entries. The upper rows are the large ones, so that their rounding does not spoil
 * the small ones. */
static inline void program_factor(real bottom, scene_control_program *m)
{
  real ahead[N_U];
  int i, j, k;
  for (i = 0; i < N_U * N_U; ++i) {
    m->matrix[N_ROWS * N_U + i] = i % (N_U + 1) == 0 ? bottom : (real)0.0;
  }
  /* Columns before k are of no use any more; loops of one length are faster. */
  for (k = 0; k < N_U; ++k) {
    real *pivot = m->matrix + k * N_U, *v = m->reflection + k * N_ROWS, *own = m->root + program_row(k);
    real norm = pivot[k] * pivot[k], inverse;
    for (i = 0; i < N_ROWS; ++i) {
      v[i] = pivot[(i + 1) * N_U + k];
      norm += v[i] * v[i];
    }
    norm = pivot[k] > (real)0.0 ? program_root(norm) : -program_root(norm);
    inverse = (real)1.0 / (pivot[k] + norm);
    m->strength[k] = (pivot[k] + norm) / norm;
    for (j = 0; j < N_U; ++j) {
      ahead[j] = pivot[j];
    }
    for (i = 0; i < N_ROWS; ++i) {
      const real *row = pivot + (i + 1) * N_U, part = v[i] * inverse;
      v[i] = part;
      for (j = 0; j < N_U; ++j) {
        ahead[j] += part * row[j];
      }
    }
    for (j = 0; j < N_U; ++j) {
      ahead[j] *= m->strength[k];
    }
    for (j = k; j < N_U; ++j) {
      own[j] = pivot[j] - ahead[j];
    }
    for (i = 0; i < N_ROWS; ++i) {
      real *row = pivot + (i + 1) * N_U;
      const real part = v[i];
      for (j = 0; j < N_U; ++j) {
        row[j] -= part * ahead[j];
      }
    }
  }
  m->is_inverted = 0;
}

/* shift = -Q^T b. */
static inline void program_turn(scene_control_program *m)
{
  int i, k;
  for (k = 0; k < N_U; ++k) {
    const real *v = m->reflection + k * N_ROWS;
    real *b = m->target + k, even = b[0], odd = (real)0.0;
    for (i = 0; i + 1 < N_ROWS; i += 2) {
      even += v[i] * b[i + 1];
      odd += v[i + 1] * b[i + 2];
    }
    for (; i < N_ROWS; ++i) {
      even += v[i] * b[i + 1];
    }
    even = m->strength[k] * (even + odd);
    m->shift[k] = even - b[0];
    for (i = 0; i < N_ROWS; ++i) {
      b[i + 1] -= v[i] * even;
    }
  }
}

/* Whether x is within its bounds, up to a tolerance; no if it is not finite. */
static inline int program_is_within(real tolerance, const scene_control_program *m)
{
  int i, k;
  for (k = 0; k < N_BOUNDS; ++k) {
    real reached = (real)0.0;
    if (k < N_U) {
      reached = m->x[k];
    } else {
      for (i = 0; i < N_U; ++i) {
        reached += m->sum[(k - N_U) * N_U + i] * m->x[i];
      }
    }
    if (!(reached >= m->lower[k] - tolerance && reached <= m->upper[k] + tolerance && reached - reached == (real)0.0)) {
      return 0;
    }
  }
  return 1;
}

/* x for y = move - shift: R x = y. */
static inline void program_turn_back(scene_control_program *m)
{
  int i, j;
  for (i = N_U - 1; i >= 0; --i) {
    const real *own = m->root + program_row(i);
    real even = m->move[i] - m->shift[i], odd = (real)0.0;
    for (j = i + 1; j + 1 < N_U; j += 2) {
      even -= own[j] * m->x[j];
      odd += own[j + 1] * m->x[j + 1];
    }
    for (; j < N_U; ++j) {
      even -= own[j] * m->x[j];
    }
    m->x[i] = (even - odd) / own[i];
  }
}

/* x without bounds; returns whether it is within them. */
static inline int program_solve_freely(scene_control_program *m)
{
  int k;
  for (k = 0; k < N_U; ++k) {
    m->move[k] = (real)0.0;
  }
  program_turn_back(m);
  return program_is_within(m->tolerance, m);
}

/* Rows of R^-1, entry by entry from row R = (0 .. 1 .. 0); the memory of the matrix is free for sums. */
static inline void program_invert_rows(scene_control_program *m)
{
  real own[N_U];
  int i, j, k;
  for (i = 0; i < N_U * N_U; ++i) {
    m->matrix[i] = (real)0.0;
  }
  for (k = 0; k < N_U; ++k) {
    const real *from = m->root + program_row(k), pivot = (real)1.0 / from[k];
    for (j = 0; j < N_U; ++j) {
      own[j] = j < k ? (real)0.0 : from[j];
    }
    for (i = 0; i <= k; ++i) {
      real *sum = m->matrix + i * N_U;
      const real entry = ((i == k ? (real)1.0 : (real)0.0) - sum[k]) * pivot;
      m->inverse[program_row(i) + k] = entry;
      for (j = 0; j < N_U; ++j) {
        sum[j] += entry * own[j];
      }
    }
  }
}

/* Rows of R^-1, and of the sums times R^-1, all of unit norm; scaling: 1 over their norms. */
static inline void program_invert(scene_control_program *m)
{
  int i, j, k;
  program_invert_rows(m);
  for (k = 0; k < N_SHARED; ++k) {
    real *row = m->turned_sum + k * N_U;
    for (j = 0; j < N_U; ++j) {
      row[j] = (real)0.0;
      for (i = 0; i <= j; ++i) {
        row[j] += m->sum[k * N_U + i] * m->inverse[program_row(i) + j];
      }
    }
    m->scaling[N_U + k] = program_make_unit(row, N_U);
  }
  for (i = 0; i < N_U; ++i) {
    m->scaling[i] = program_make_unit(m->inverse + program_row(i) + i, N_U - i);
  }
  m->is_inverted = 1;
}

/* Binds DAQP to the memory. Active at first are the constraints of the program before, and those of equal bounds. */
static inline void program_bind(program_solver *solver, scene_control_program *m)
{
  DAQPWorkspace work;
  DAQPProblem problem;
  int k;
  memset(&work, 0, sizeof work);
  memset(&problem, 0, sizeof problem);
  solver->settings = program_settings(m->tolerance, QP_ITERATIONS, N_SET);
  problem.n = work.n = N_U;
  problem.m = work.m = N_BOUNDS;
  problem.ms = work.ms = N_U;
  problem.A = m->sum;
  problem.bupper = m->upper;
  problem.blower = m->lower;
  solver->problem = problem;
  work.qp = &solver->problem;
  work.settings = &solver->settings;
  work.M = m->turned_sum;
  work.Mu = N_SHARED > 0 ? m->product : NULL;
  work.dupper = m->most;
  work.dlower = m->least;
  work.Rinv = m->inverse;
  work.v = m->shift;
  work.sense = m->sense;
  work.scaling = m->scaling;
  work.x = m->x;
  work.u = m->move;
  work.lam = m->multiplier;
  work.lam_star = m->stationary;
  work.L = m->factor;
  work.D = m->diagonal;
  work.xldl = m->spare;
  work.zldl = m->spare + N_SET;
  work.WS = m->set;
  work.state = DAQP_STATE_RINV_NORMALIZED;
  solver->work = work;
  reset_daqp_workspace(&solver->work);
  for (k = 0; k < N_BOUNDS; ++k) {
    m->sense[k] &= DAQP_ACTIVE + DAQP_LOWER;
    if (m->upper[k] - m->lower[k] < solver->settings.zero_tol) {
      m->sense[k] = DAQP_ACTIVE + DAQP_IMMUTABLE;
    }
  }
}

/* Bounds of y: those of x times scaling, shifted. */
static inline void program_shift_bounds(scene_control_program *m)
{
  int j, k;
  for (k = 0; k < N_BOUNDS; ++k) {
    const int is_sum = k >= N_U;
    const real *row = is_sum ? m->turned_sum + (k - N_U) * N_U : m->inverse + program_row(k);
    real by = (real)0.0;
    for (j = is_sum ? 0 : k; j < N_U; ++j) {
      by += row[j] * m->shift[j];
    }
    m->least[k] = m->lower[k] * m->scaling[k] + by;
    m->most[k] = m->upper[k] * m->scaling[k] + by;
  }
}

/* Forgets which constraints were active. */
static inline void program_forget(scene_control_program *m)
{
  int k;
  for (k = 0; k < N_BOUNDS; ++k) {
    m->sense[k] = 0;
  }
}

/* x within its bounds for the factors of program_factor; returns whether it was found. `is_first`: nothing was solved
 * with these factors before, else the active constraints are those of the last time. */
static inline int program_solve(int is_first, program_solver *solver, scene_control_program *m)
{
  int is_found, k, n_active = 0;
  program_turn(m);
  for (k = 0; k < N_BOUNDS; ++k) {
    n_active += m->sense[k] & DAQP_ACTIVE;
  }
  if (n_active == 0 && program_solve_freely(m)) {
    m->iterations = m->iterations > 1 ? m->iterations : 1;
    return 1;
  }
  is_first |= !m->is_inverted;
  if (!m->is_inverted) {
    program_invert(m);
  }
  if (is_first) {
    program_bind(solver, m);
  }
  program_shift_bounds(m);
  solver->work.reuse_ind = 0;
  is_found = !is_first || daqp_activate_constraints(&solver->work) >= 0;
  if (is_found) {
    is_found = daqp_ldp(&solver->work) > 0;
    m->iterations = m->iterations > solver->work.iterations ? m->iterations : solver->work.iterations;
  }
  if (is_found) {
    program_turn_back(m);
    daqp_refine_primal(&solver->work);
    is_found = program_is_within((real)1000.0 * m->tolerance, m);
  }
  if (!is_found) {
    program_forget(m);
  }
  return is_found;
}

#endif
