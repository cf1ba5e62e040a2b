#ifndef MPC_CONDENSE_H
#define MPC_CONDENSE_H
#include "daqp_static.h"
#include "mpc_stages.h"

/* The quadratic program over the changes x of the moves alone: errors of the states of the horizon are replaced by their
 * derivatives by x. Rows: rates between blocks, then of each block the members with a least tension and the coordinates
 * with bounds, at the end of the block. */

/* to += factor from, of so many numbers. */
static inline void mpc_add_multiple(int count, real factor, const real *from, real *to)
{
  int j;
  for (j = 0; j < count; ++j) {
    to[j] += factor * from[j];
  }
}

/* hessian += y^T y in its upper triangle, gradient += y^T error; y (rows, columns). */
static inline void mpc_add_squares(int rows, int columns, scene_control_mpc *m)
{
  int a, b, i;
  for (i = 0; i < rows; i += 4) {
    static const real NOTHING[N_V] = {(real)0.0};
    const real *y0 = m->weighted + i * N_V, *y1 = i + 1 < rows ? y0 + N_V : NOTHING;
    const real *y2 = i + 2 < rows ? y0 + 2 * N_V : NOTHING, *y3 = i + 3 < rows ? y0 + 3 * N_V : NOTHING;
    const real *e = m->weighted_error + i;
    const real e0 = e[0], e1 = i + 1 < rows ? e[1] : (real)0.0;
    const real e2 = i + 2 < rows ? e[2] : (real)0.0, e3 = i + 3 < rows ? e[3] : (real)0.0;
    for (a = 0; a < columns; ++a) {
      real *sum = m->hessian + a * N_V;
      const real a0 = y0[a], a1 = y1[a], a2 = y2[a], a3 = y3[a];
      for (b = a; b < columns; ++b) {
        sum[b] += (a0 * y0[b] + a1 * y1[b]) + (a2 * y2[b] + a3 * y3[b]);
      }
      m->gradient[a] += (a0 * e0 + a1 * e1) + (a2 * e2 + a3 * e3);
    }
  }
}

/* Add the cost of a state of the horizon, whose errors are set; columns: moves that change it. */
static inline void mpc_add_cost(int is_last, int columns, scene_control_mpc *m)
{
  const int rows = is_last ? N_S : N_WEIGHTED;
  const real *root = LAST_ROOT;
  int i, j, k;
  for (i = 0; i < rows; ++i) {
    real *y = m->weighted + i * N_V, error = (real)0.0;
    for (j = 0; j < columns; ++j) {
      y[j] = (real)0.0;
    }
    if (is_last) {
      mpc_add_product(1, N_S - i, columns, root, 0, m->by_move + i * N_V, N_V, y, 0);
      for (k = i; k < N_S; ++k) {
        error += root[k - i] * m->error[k];
      }
      root += N_S - i;
    } else {
      for (k = WEIGHT_START[i]; k < WEIGHT_START[i + 1]; ++k) {
        const int from = WEIGHT_COLUMN[k];
        mpc_add_multiple(columns, WEIGHT_ROOT[k], m->by_move + from * N_V, y);
        error += WEIGHT_ROOT[k] * m->error[from];
      }
    }
    m->weighted_error[i] = error;
  }
  mpc_add_squares(rows, columns, m);
}

/* Set the errors of a state of the plan, changed as without changes of the moves. */
static inline void mpc_set_error(int k, scene_control_mpc *m)
{
  int i;
  for (i = 0; i < N_X; ++i) {
    m->error[i] = m->state[k * N_X + i] + m->free_change[i] - m->goal[k * N_X + i];
  }
}

/* Go on from the state k of the horizon to the next one; columns: moves that change that. */
static inline void mpc_propagate(int k, int columns, scene_control_mpc *m)
{
  const real *transition = m->transition + k * N_X * N_X, *effect = m->effect + k * N_X * N_U;
  real next[N_X];
  int i, j, u;
#if WITH_SUMS
  /* The sums take the errors of the state before. */
  for (i = 0; i < N_Z; ++i) {
    for (j = 0; j < N_X; ++j) {
      const real by = SUM_OUTPUT[i * N_X + j];
      if (by < (real)0.0 || by > (real)0.0) {
        m->error[N_X + i] += by * m->error[j];
        mpc_add_multiple(columns, by, m->by_move + j * N_V, m->by_move + (N_X + i) * N_V);
      }
    }
  }
#endif
  for (i = 0; i < N_X; ++i) {
    next[i] = m->gap[k * N_X + i];
    for (j = 0; j < N_X; ++j) {
      next[i] += transition[i * N_X + j] * m->free_change[j];
    }
  }
  for (i = 0; i < N_X; ++i) {
    m->free_change[i] = next[i];
    for (j = 0; j < columns; ++j) {
      m->next_by_move[i * N_V + j] = (real)0.0;
    }
  }
  mpc_add_product(N_X, N_X, columns, transition, N_X, m->by_move, N_V, m->next_by_move, N_V);
  for (u = 0; u < N_U; ++u) {
    const real share = mpc_old_share(u);
    const int number = k - DELAY_SAMPLES[u];
    for (i = 0; number >= 0 && i < N_X; ++i) {
      m->next_by_move[i * N_V + mpc_block(number) * N_U + u] += ((real)1.0 - share) * effect[i * N_U + u];
    }
    for (i = 0; number >= 1 && share > (real)0.0 && i < N_X; ++i) {
      m->next_by_move[i * N_V + mpc_block(number - 1) * N_U + u] += share * effect[i * N_U + u];
    }
  }
  for (i = 0; i < N_X; ++i) {
    for (j = 0; j < columns; ++j) {
      m->by_move[i * N_V + j] = m->next_by_move[i * N_V + j];
    }
  }
}

#if WITH_LIMITED
/* Longest rest length of a member with its least tension at a length, and its derivative. */
static inline real mpc_longest_rest(int e, real length, real *slope)
{
  if (LIMITED_AXIAL[e] > (real)0.0) {
    *slope = LIMITED_AXIAL[e] / (LIMITED_AXIAL[e] + LIMITED_TENSION[e]);
    return *slope * length;
  }
  *slope = (real)1.0;
  return length - LIMITED_TENSION[e] / LIMITED_SPRING[e];
}

/* Set the rows of the least tensions of a block that ends in the sample k: rest length at most the longest one. Returns
 * whether they are finite. */
static inline int mpc_add_tension_rows(int k, int columns, int row, scene_control_mpc *m)
{
  const real *state = m->state + (k + 1) * N_X, *input = m->input + k * N_IN;
  int e, i, p;
  if (mpc_geometry(state, m->length, m->entry) != 0) {
    return 0;
  }
  memset(m->length_rate, 0, sizeof m->length_rate);
  for (i = 0; i < (int)(sizeof LENGTH_PLACE / sizeof LENGTH_PLACE[0]); ++i) {
    if (LENGTH_PLACE[i] >= 0) {
      m->length_rate[LENGTH_PLACE[i]] = m->entry[i];
    }
  }
  for (e = 0; e < N_LIMITED; ++e, ++row) {
    real *by = m->row + row * N_V, slope, room = (real)0.0, rest = LIMITED_REST[e];
    const real longest = mpc_longest_rest(e, m->length[LIMITED_MEMBER[e]], &slope);
    for (i = 0; i < N_Q; ++i) {
      const real rate = -slope * m->length_rate[i * N_LIMITED + e];
      room -= rate * m->free_change[i];
      mpc_add_multiple(columns, rate, m->by_move + i * N_V, by);
    }
    for (p = LIMITED_OTHER_START[e]; p < LIMITED_OTHER_START[e + 1]; ++p) {
      rest += input[LIMITED_OTHER[p]];
    }
    for (p = LIMITED_PULL_START[e]; p < LIMITED_PULL_START[e + 1]; ++p) {
      const int u = LIMITED_PULL[p], number = k - DELAY_SAMPLES[u];
      const real share = mpc_old_share(u);
      rest += input[ACTUATOR_PLACE[u]];
      if (number >= 0) {
        by[mpc_block(number) * N_U + u] += (real)1.0 - share;
      }
      if (number >= 1) {
        by[mpc_block(number - 1) * N_U + u] += share;
      }
    }
    m->lower[N_V + row] = -(real)DAQP_INF;
    m->upper[N_V + row] = longest - rest + room;
  }
  return 1;
}
#endif

/* Set the rows of a block that ends in the sample k; returns whether they are finite. */
static inline int mpc_add_rows(int k, int block, int columns, scene_control_mpc *m)
{
  int row = (N_BLOCKS - 1) * N_U + block * (N_LIMITED + N_BOUNDED), i, j;
#if WITH_LIMITED
  if (!mpc_add_tension_rows(k, columns, row, m)) {
    return 0;
  }
  row += N_LIMITED;
#endif
  for (i = 0; i < N_BOUNDED; ++i, ++row) {
    const real now = m->state[(k + 1) * N_X + BOUNDED[i]] + m->free_change[BOUNDED[i]];
    for (j = 0; j < columns; ++j) {
      m->row[row * N_V + j] = m->by_move[BOUNDED[i] * N_V + j];
    }
    m->lower[N_V + row] = BOUNDED_LEAST[i] - now;
    m->upper[N_V + row] = BOUNDED_MOST[i] - now;
  }
  return 1;
}

/* Set bounds of the changes of the moves: by ranges at the end of each block, of the first one by c->work.low and high;
 * and the rows of rates between blocks. */
static inline void mpc_set_actuator_bounds(scene_control *c)
{
  scene_control_mpc *m = &c->mpc;
  int b, u;
  for (b = 0; b < N_BLOCKS; ++b) {
    const int last = BLOCK_START[b + 1] - 1, before = BLOCK_START[b] - 1;
    for (u = 0; u < N_U; ++u) {
      const int v = b * N_U + u, row = v - N_U;
      const real now = m->planned[last * N_U + u] + m->move[v];
      if (b == 0) {
        m->lower[v] = c->work.low[u] - m->planned[u] - m->move[u];
        m->upper[v] = c->work.high[u] - m->planned[u] - m->move[u];
      } else {
        const real reach = ACTUATOR_RATE[u] * CONTROL_SAMPLE * (real)(last - before);
        const real step = now - m->planned[before * N_U + u] - m->move[v - N_U];
        m->lower[v] = ACTUATOR_LEAST[u] - now;
        m->upper[v] = ACTUATOR_MOST[u] - now;
        m->row[row * N_V + v] = (real)1.0;
        m->row[row * N_V + v - N_U] = (real)-1.0;
        m->lower[N_V + row] = -reach - step;
        m->upper[N_V + row] = reach - step;
      }
    }
  }
}

/* Set the program; sums (N_Z,): of the errors until now. Returns whether all of it is finite. */
static inline int mpc_condense(const real *sums, scene_control *c)
{
  scene_control_mpc *m = &c->mpc;
  int b, block = 0, i, j, k, u;
  memset(m->hessian, 0, sizeof m->hessian);
  memset(m->gradient, 0, sizeof m->gradient);
  memset(m->by_move, 0, sizeof m->by_move);
  memset(m->row, 0, sizeof m->row);
  memset(m->free_change, 0, sizeof m->free_change);
  for (i = 0; i < N_Z; ++i) {
    m->error[N_X + i] = sums[i];
  }
  mpc_set_error(0, m);
  /* Costs of the states. */
  for (k = 0; k < N_STAGES; ++k) {
    const int columns = k < LEAST_DELAY ? 0 : (mpc_block(k - LEAST_DELAY) + 1) * N_U;
    mpc_propagate(k, columns, m);
    mpc_set_error(k + 1, m);
    if (columns > 0) {
      mpc_add_cost(k == N_STAGES - 1, columns, m);
    }
    if (block < N_BLOCKS && k + 1 == BLOCK_START[block + 1] + N_STAGES - N_HORIZON) {
      if (!mpc_add_rows(k, block, columns, m)) {
        return 0;
      }
      ++block;
    }
  }
  /* Costs of the moves. */
  for (b = 0; b < N_BLOCKS; ++b) {
    const real count = (real)(BLOCK_START[b + 1] - BLOCK_START[b]);
    for (i = 0; i < N_U; ++i) {
      for (j = 0; j < N_U; ++j) {
        const real weight = count * INPUT_WEIGHT[i * N_U + j];
        m->hessian[(b * N_U + i) * N_V + b * N_U + j] += j >= i ? weight : (real)0.0;
        m->gradient[b * N_U + i] += weight * m->move[b * N_U + j];
      }
    }
  }
  mpc_set_actuator_bounds(c);
  for (u = 0; u < N_CONSTRAINTS; ++u) {
    m->upper[u] = m->upper[u] < m->lower[u] ? m->lower[u] : m->upper[u];
  }
  return control_all_finite(m->hessian, N_V * N_V) && control_all_finite(m->gradient, N_V);
}

#endif
