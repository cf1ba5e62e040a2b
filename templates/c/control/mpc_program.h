#ifndef MPC_PROGRAM_H
#define MPC_PROGRAM_H
#include "daqp_settings.h"
#include "mpc_condense.h"

/* Least 0.5 x H x + gradient x within bounds of x and of rows: without active constraints by H = R^T R, else by DAQP with
 * y = R x. Soft constraints cost 0.5 weight excess^2. Triangles are stored row by row, from the diagonal on. */

#if WITH_FLOAT
#define MPC_TOLERANCE (real)1e-6 /* of bounds [m, and units of coordinates] */
#else
#define MPC_TOLERANCE (real)1e-10 /* of bounds [m, and units of coordinates] */
#endif

/* Replace H by R in its upper triangle; returns whether H is positive definite. */
static inline int mpc_factor(scene_control_mpc *m)
{
  int i, k;
  for (k = 0; k < N_V; ++k) {
    real *own = m->hessian + k * N_V;
    const real pivot = own[k];
    real inverse;
    if (!(pivot > (real)0.0)) {
      return 0;
    }
    inverse = (real)1.0 / program_root(pivot);
    for (i = k; i < N_V; ++i) {
      own[i] *= inverse;
    }
    for (i = k + 1; i < N_V; ++i) {
      mpc_add_multiple(N_V - i, -own[i], own + i, m->hessian + i * N_V + i);
    }
  }
  return 1;
}

/* shift = R^-T gradient. */
static inline void mpc_turn_gradient(scene_control_mpc *m)
{
  int k;
  for (k = 0; k < N_V; ++k) {
    m->shift[k] = m->gradient[k];
  }
  for (k = 0; k < N_V; ++k) {
    const real *own = m->hessian + k * N_V;
    m->shift[k] /= own[k];
    mpc_add_multiple(N_V - k - 1, -m->shift[k], own + k + 1, m->shift + k + 1);
  }
}

/* x = R^-1 (move_root - shift). */
static inline void mpc_turn_back(scene_control_mpc *m)
{
  int i, j;
  for (i = N_V - 1; i >= 0; --i) {
    const real *own = m->hessian + i * N_V;
    real sum = m->move_root[i] - m->shift[i];
    for (j = i + 1; j < N_V; ++j) {
      sum -= own[j] * m->x[j];
    }
    m->x[i] = sum / own[i];
  }
}

/* Product of a row with x. */
static inline real mpc_row_product(int row, const scene_control_mpc *m)
{
  const real *by = m->row + row * N_V;
  real sum = (real)0.0;
  int j;
  for (j = 0; j < N_V; ++j) {
    sum += by[j] * m->x[j];
  }
  return sum;
}

/* Whether x is within its bounds and the rows up to this one within theirs, up to a tolerance. */
static inline int mpc_is_within(int n_rows, real tolerance, const scene_control_mpc *m)
{
  int k;
  for (k = 0; k < N_V + n_rows; ++k) {
    const real value = k < N_V ? m->x[k] : mpc_row_product(k - N_V, m);
    if (!(value >= m->lower[k] - tolerance && value <= m->upper[k] + tolerance)) {
      return 0;
    }
  }
  return 1;
}

/* First entry of a row of a triangle, less its column. */
static inline int mpc_row_start(int i) { return i * N_V - i * (i + 1) / 2; }

/* R^-1 and rows R^-1, of norm 1; scaling: 1 over their norms. */
static inline void mpc_invert(scene_control_mpc *m)
{
  int i, j, k;
  /* Row i of R^-1 from the rows of R, from its diagonal on. */
  for (i = 0; i < N_V; ++i) {
    real *own = m->inverse + mpc_row_start(i);
    for (j = i; j < N_V; ++j) {
      own[j] = (real)0.0;
    }
    own[i] = (real)1.0;
    for (k = i; k < N_V; ++k) {
      const real *from = m->hessian + k * N_V;
      own[k] /= from[k];
      mpc_add_multiple(N_V - k - 1, -own[k], from + k + 1, own + k + 1);
    }
  }
  for (k = 0; k < N_ROWS; ++k) {
    real *to = m->turned + k * N_V;
    for (j = 0; j < N_V; ++j) {
      to[j] = (real)0.0;
    }
    for (i = 0; i < N_V; ++i) {
      const real by = m->row[k * N_V + i];
      if (by < (real)0.0 || by > (real)0.0) {
        mpc_add_multiple(N_V - i, by, m->inverse + mpc_row_start(i) + i, to + i);
      }
    }
    m->scaling[N_V + k] = program_make_unit(to, N_V);
  }
  for (i = 0; i < N_V; ++i) {
    m->scaling[i] = program_make_unit(m->inverse + mpc_row_start(i) + i, N_V - i);
  }
}

/* Bounds of y, which constraints are soft, and those that are active at first: as in the last step. */
static inline void mpc_set_constraints(scene_control_mpc *m)
{
  int j, k;
  for (k = 0; k < N_CONSTRAINTS; ++k) {
    const real *row = k < N_V ? m->inverse + mpc_row_start(k) : m->turned + (k - N_V) * N_V;
    const int soft = k - N_V - (N_BLOCKS - 1) * N_U;
    real by = (real)0.0;
    for (j = k < N_V ? k : 0; j < N_V; ++j) {
      by += row[j] * m->shift[j];
    }
    m->least[k] = m->lower[k] * m->scaling[k] + by;
    m->most[k] = m->upper[k] * m->scaling[k] + by;
    m->softness[k] = (real)0.0;
    m->sense[k] &= DAQP_ACTIVE + DAQP_LOWER;
    if (soft >= 0) {
      m->softness[k] = (real)1.0 / SOFT_WEIGHT[0];
      m->sense[k] |= DAQP_SOFT;
    } else if (m->upper[k] - m->lower[k] <= (real)0.0) {
      m->sense[k] = DAQP_ACTIVE + DAQP_IMMUTABLE;
    }
  }
}

/* Largest excess of x over a soft limit. */
static inline real mpc_find_excess(const scene_control_mpc *m)
{
  real largest = (real)0.0;
  int k;
  for (k = (N_BLOCKS - 1) * N_U; k < N_ROWS; ++k) {
    const real value = mpc_row_product(k, m);
    const real over = value - m->upper[N_V + k], under = m->lower[N_V + k] - value;
    largest = over > largest ? over : largest;
    largest = under > largest ? under : largest;
  }
  return largest;
}

/* x by DAQP; returns whether it was found. */
static inline int mpc_solve_active(scene_control_mpc *m)
{
  DAQPWorkspace work;
  DAQPSettings settings = program_settings(MPC_TOLERANCE, QP_ITERATIONS, N_SET);
  DAQPProblem problem;
  int exit;
  memset(&work, 0, sizeof work);
  memset(&problem, 0, sizeof problem);
  mpc_invert(m);
  mpc_set_constraints(m);
  problem.n = work.n = N_V;
  problem.m = work.m = N_CONSTRAINTS;
  problem.ms = work.ms = N_V;
  problem.A = m->row;
  problem.bupper = m->upper;
  problem.blower = m->lower;
  work.qp = &problem;
  work.settings = &settings;
  work.M = m->turned;
  work.Mu = m->product;
  work.dupper = m->most;
  work.dlower = m->least;
  work.Rinv = m->inverse;
  work.v = m->shift;
  work.sense = m->sense;
  work.scaling = m->scaling;
  work.x = m->x;
  work.u = m->move_root;
  work.lam = m->multiplier;
  work.lam_star = m->stationary;
  work.L = m->factor;
  work.D = m->diagonal;
  work.xldl = m->spare;
  work.zldl = m->spare + N_SET;
  work.WS = m->set;
  work.rho_ls = m->softness;
  work.rho_us = m->softness;
  work.state = DAQP_STATE_RINV_NORMALIZED;
  reset_daqp_workspace(&work);
  exit = daqp_activate_constraints(&work);
  exit = exit < 0 ? exit : daqp_ldp(&work);
  m->iterations = work.iterations;
  if (exit > 0) {
    mpc_turn_back(m);
    exit = mpc_is_within((N_BLOCKS - 1) * N_U, (real)1000.0 * MPC_TOLERANCE, m) ? exit : DAQP_EXIT_CYCLE;
    m->soft_excess = mpc_find_excess(m);
  }
  /* At the limit of iterations the next step goes on with the constraints that are active now. */
  if (exit <= 0 && exit != DAQP_EXIT_ITERLIMIT) {
    memset(m->sense, 0, sizeof m->sense);
  }
  return exit > 0;
}

/* Solve the program that is set; returns whether x was found. */
static inline int mpc_solve(scene_control_mpc *m)
{
  int is_found, k, n_active = 0;
  if (!mpc_factor(m)) {
    return 0;
  }
  mpc_turn_gradient(m);
  for (k = 0; k < N_CONSTRAINTS; ++k) {
    n_active += m->sense[k] & DAQP_ACTIVE;
  }
  m->iterations = 1;
  m->soft_excess = (real)0.0;
  for (k = 0; k < N_V; ++k) {
    m->move_root[k] = (real)0.0;
  }
  mpc_turn_back(m);
  is_found = mpc_is_within(N_ROWS, (real)0.0, m);
  if (is_found && n_active > 0) {
    memset(m->sense, 0, sizeof m->sense);
  }
  if (!is_found) {
    is_found = mpc_solve_active(m);
  }
  return is_found;
}

#endif
