#ifndef MEMBER_STEPS_H
#define MEMBER_STEPS_H
#include "equilibrium_memory.h"

#if !WITH_FLOAT
#if WITH_MEMBERS
/* Steps of a search for an equilibrium that damp single members and keep the predicted lengths of stiff ones. Each
 * solves (K* + D^T S D + shift I) s = f. D s are the differences of the ends of members, S their damping. Stiff members
 * are those above the widest gap of spring constants. Steps lead along curves on which these have the lengths l + J s,
 * J = dl/dq; K* is the Hessian of the energy along such curves, the one for tensions t + dt with (J J^T) dt = J f. */
enum { MEMBER_ATTEMPTS = 40, MEMBER_FACTORS = 60, MEMBER_CORRECTIONS = 60 }; /* most of them in one step */

/* Difference of the ends of a member, of a vector over the coordinates; anchors do not move. */
static inline void member_difference(int member, const double *field, double *difference)
{
  const short *at = equilibrium_ends() + 6 * member;
  int k;
  for (k = 0; k < 3; ++k) {
    difference[k] = (at[k] >= 0 && at[k] < N ? field[at[k]] : 0.0)
        - (at[k + 3] >= 0 && at[k + 3] < N ? field[at[k + 3]] : 0.0);
  }
}

/* Part of a difference of ends along a member: its elongation. */
static inline double member_elongation(const equilibrium_members *at, int member, const double *difference)
{
  const double *v = at->vector + 3 * member;
  return (v[0] * difference[0] + v[1] * difference[1] + v[2] * difference[2]) / at->length[member];
}

/* Adds a tension of a member to a vector over the coordinates, as +factor u at its first end and -factor u at the
 * other. */
static inline void member_pull(const equilibrium_members *place, int member, double factor, double *field)
{
  const short *at = equilibrium_ends() + 6 * member;
  int k;
  for (k = 0; k < 6; ++k) {
    if (at[k] >= 0 && at[k] < N) {
      field[at[k]] += (k < 3 ? factor : -factor) * place->vector[3 * member + k % 3] / place->length[member];
    }
  }
}

static inline void member_locate(
    const double *coordinate, const equilibrium_arguments *arguments, int member, equilibrium_members *at)
{
  double *v = at->vector + 3 * member;
  equilibrium_vector(coordinate, arguments, member, v);
  at->length[member] = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Vectors, lengths and tensions of all members; returns whether these are finite. */
static inline int member_locate_all(
    const double *coordinate, const equilibrium_arguments *arguments, equilibrium_members *at)
{
  int k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    member_locate(coordinate, arguments, k, at);
  }
  equilibrium_tension(coordinate, arguments, at->tension);
  return all_finite(at->tension, EQUILIBRIUM_MEMBERS);
}

/* Lists the stiff members, those above the widest gap between spring constants, if it is at least 10. A small
 * displacement shows these. Members that are more than the coordinates leave nothing to move: none is stiff then. */
static inline void member_list_stiff(
    const double *coordinate, const equilibrium_arguments *arguments, equilibrium_memory *m)
{
  const double *constant = m->spring_constant;
  double widest = 10.0, limit = INFINITY;
  int i, k;
  for (k = 0; k < N; ++k) {
    m->trial[k] = coordinate[k] + 1e-6 * m->longest * sin(1.0 + 2.4 * k);
  }
  member_locate_all(m->trial, arguments, &m->there);
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double change = fabs(m->there.length[k] - m->here.length[k]);
    const double pull = fabs(m->there.tension[k] - m->here.tension[k]);
    m->damping[k] = 0.0;
    m->spring_constant[k] = change > 1e-9 * m->longest && pull < INFINITY ? pull / change : 0.0;
  }
  for (i = 0; i < EQUILIBRIUM_MEMBERS; ++i) {
    double next = INFINITY;
    for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
      next = constant[k] > constant[i] && constant[k] < next ? constant[k] : next;
    }
    if (constant[i] > 0.0 && next < INFINITY && next >= widest * constant[i]) {
      widest = next / constant[i];
      limit = next;
    }
  }
  m->n_stiff = 0;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    if (constant[k] >= limit && m->n_stiff++ < N) {
      m->stiff[m->n_stiff - 1] = k;
    }
  }
  m->n_stiff = m->n_stiff > N ? 0 : m->n_stiff;
  m->part = m->shift = 0.0;
  m->is_started = 1;
}

/* Factors of J J^T, tensions that balance the forces best, and what goes with them; returns whether all is finite. */
static inline int member_balance(
    const double *coordinate, const equilibrium_arguments *arguments, equilibrium_memory *m)
{
  const int n = m->n_stiff;
  double difference[3], pivot;
  int i, k;
  for (i = 0; i < n; ++i) {
    member_difference(m->stiff[i], m->force, difference);
    m->gap[i] = member_elongation(&m->here, m->stiff[i], difference);
    for (k = 0; k < N; ++k) {
      m->step[k] = 0.0;
    }
    member_pull(&m->here, m->stiff[i], 1.0, m->step);
    for (k = 0; k <= i; ++k) {
      member_difference(m->stiff[k], m->step, difference);
      m->stiff_factor[i * n + k] = member_elongation(&m->here, m->stiff[k], difference);
    }
    m->stiff_factor[i * (n + 1)] += 1e-10;
  }
  if (!cholesky_factor(n, m->stiff_factor, &pivot)) {
    return 0;
  }
  cholesky_solve(n, m->stiff_factor, m->gap, m->gap);
  m->largest_force = largest_entry(m->force);
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double tension = m->here.tension[k];
    m->largest_force = fabs(tension) > m->largest_force ? fabs(tension) : m->largest_force;
    m->density[k] = 0.0;
  }
  for (i = 0; i < n; ++i) {
    m->density[m->stiff[i]] = m->gap[i] / m->here.length[m->stiff[i]];
  }
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double density = m->here.tension[k] / m->here.length[k] + m->density[k];
    m->compression[k] = density < 0.0 ? -density : 0.0;
  }
  (void)coordinate;
  (void)arguments;
  return 1;
}

/* Adds D_k^T (even I + along u u^T) D_k of a member to the lower half of a matrix. */
static inline void member_add(
    const equilibrium_members *place, int member, double even, double along, double *matrix)
{
  const short *at = equilibrium_ends() + 6 * member;
  const double *v = place->vector + 3 * member;
  int i, k;
  along /= place->length[member] * place->length[member];
  for (i = 0; i < 6; ++i) {
    for (k = 0; k < 6; ++k) {
      if (at[i] < N && at[k] >= 0 && at[k] <= at[i]) {
        const double block = (i % 3 == k % 3 ? even : 0.0) + along * v[i % 3] * v[k % 3];
        matrix[at[i] * N + at[k]] += i / 3 == k / 3 ? block : -block;
      }
    }
  }
}

/* Factors of K* with the damping, of which there is more until it is positive definite; returns whether it is. */
static inline int member_factor(equilibrium_memory *m)
{
  const double force_density = m->largest_force / m->longest;
  double largest = 0.0, pivot;
  int count, k;
  for (k = 0; k < N; ++k) {
    largest = m->weight[k] > largest ? m->weight[k] : largest;
  }
  largest *= 4e-13;
  for (count = 0; count < MEMBER_FACTORS; ++count) {
    cholesky_fill(m->hessian, equilibrium_row(), equilibrium_column_start(), 0.0, m->weight, m->factor);
    for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
      const double even = m->density[k] + m->damping[k] + m->part * m->compression[k];
      if (even != 0.0 || m->density[k] != 0.0) {
        member_add(&m->here, k, even, -m->density[k], m->factor);
      }
    }
    for (k = 0; k < N; ++k) {
      m->factor[k * (N + 1)] += m->shift + largest;
    }
    if (cholesky_factor(N, m->factor, &pivot)) {
      return 1;
    }
    if (m->part < 1.0) {
      m->part = m->part > 0.0 ? 2.0 * m->part : 0.125;
    } else {
      m->shift = 4.0 * m->shift + 1e-3 * force_density + largest;
    }
  }
  return 0;
}

/* Sets m->trial to the end of the curve along m->step; returns whether stiff members find their lengths there. */
static inline int member_follow(
    const double *coordinate, const equilibrium_arguments *arguments, equilibrium_memory *m)
{
  double before = INFINITY, reach = m->longest, apart = 0.0, size = 0.0, difference[3];
  int count, i;
  for (i = 0; i < N; ++i) {
    m->trial[i] = coordinate[i] + m->step[i];
    reach = fabs(m->trial[i]) > reach ? fabs(m->trial[i]) : reach;
    size += m->step[i] * m->step[i];
  }
  for (i = 0; i < m->n_stiff; ++i) {
    member_difference(m->stiff[i], m->step, difference);
    m->length[i] = m->here.length[m->stiff[i]] + member_elongation(&m->here, m->stiff[i], difference);
  }
  for (count = 0; count < MEMBER_CORRECTIONS; ++count) {
    const double least = 8.0 * 2.2e-16 * reach;
    double worst = 0.0;
    for (i = 0; i < m->n_stiff; ++i) {
      member_locate(m->trial, arguments, m->stiff[i], &m->there);
      m->gap[i] = m->there.length[m->stiff[i]] - m->length[i];
      worst = fabs(m->gap[i]) <= worst ? worst : fabs(m->gap[i]);
    }
    if (!(worst < INFINITY)) {
      return 0;
    }
    if (worst <= 0.25 * least || (worst <= least && worst >= 0.5 * before)) {
      for (i = 0; i < N; ++i) {
        const double correction = m->trial[i] - coordinate[i] - m->step[i];
        apart += correction * correction;
      }
      return apart <= size;
    }
    before = worst;
    cholesky_solve(m->n_stiff, m->stiff_factor, m->gap, m->gap);
    for (i = 0; i < m->n_stiff; ++i) {
      member_pull(&m->here, m->stiff[i], -m->gap[i], m->trial);
    }
  }
  return 0;
}

/* Sets m->turn, by how much of its length the ends of each member part along m->step; returns the largest. That of
 * cables that are slack before and after does not matter. */
static inline double member_find_turn(int is_known, equilibrium_memory *m)
{
  double largest = 0.0, d[3];
  int k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double length = m->here.length[k] > 0.1 * m->longest ? m->here.length[k] : 0.1 * m->longest;
    member_difference(k, m->step, d);
    m->turn[k] = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / length;
    if (is_known && m->here.tension[k] == 0.0 && m->there.tension[k] == 0.0) {
      m->turn[k] = 0.0;
    }
    largest = m->turn[k] > largest ? m->turn[k] : largest;
  }
  return largest;
}

/* Sets m->need, the damping that would have covered the true energy of each member along the step. With elongation e
 * and difference d its energy is t e + k e^2 / 2 + t (d^2 - e^2) / 2 l to second order; where the true one is larger by
 * r, that is 2 r / d^2. Stiff members need none. */
static inline void member_find_need(equilibrium_memory *m)
{
  double d[3], along[3];
  int i, k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double before = m->here.tension[k], after = m->there.tension[k], length = m->here.length[k];
    const double change = m->there.length[k] - length;
    double energy = 0.5 * (before + after) * change, square, elongation, model, slope;
    member_difference(k, m->step, d);
    elongation = member_elongation(&m->here, k, d);
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (before != 0.0 && after != 0.0 && fabs(change) > 1e-7 * length) {
      m->spring_constant[k] = fabs((after - before) / change);
    }
    slope = m->spring_constant[k];
    for (i = 0; i < 3; ++i) {
      along[i] = m->there.vector[3 * k + i] - m->here.vector[3 * k + i];
    }
    model = before * member_elongation(&m->here, k, along)
        + 0.5 * (before != 0.0 ? slope * elongation * elongation : 0.0)
        + 0.5 * before / length * (square - elongation * elongation);
    if (slope > 0.0 && before == 0.0 && after != 0.0 && 0.5 * after * after / slope < energy) {
      energy = 0.5 * after * after / slope;
    }
    if (slope > 0.0 && before != 0.0 && after == 0.0 && -0.5 * before * before / slope > energy) {
      energy = -0.5 * before * before / slope;
    }
    m->need[k] = energy > model && square > 1e-18 * length * length ? 2.0 * (energy - model) / square : 0.0;
  }
  for (i = 0; i < m->n_stiff; ++i) {
    m->need[m->stiff[i]] = 0.0;
  }
}

/* Damps more after a step that did not make the energy fall as it should have. */
static inline void member_refuse(int is_late, equilibrium_memory *m)
{
  int k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double need = m->need[k], old = m->damping[k], least = old > need / 30.0 ? old : need / 30.0;
    const double between = cbrt(need * least * least);
    m->damping[k] = between > 2.0 * old ? between : 2.0 * old;
    if (is_late) {
      m->damping[k] = 4.0 * m->damping[k] + 0.1 * m->largest_force / m->here.length[k];
    }
  }
  if (is_late) {
    m->shift = 4.0 * m->shift + 1e-3 * m->largest_force / m->longest;
  }
}

/* Damps less after a step that made the energy fall by `ratio` of what the model without damping says. */
static inline void member_relax(double ratio, double largest_turn, int is_first, equilibrium_memory *m)
{
  const double much = largest_turn > 0.05 ? 4.0 : largest_turn < 0.002 ? 100.0 : 0.2 / largest_turn;
  int k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    m->damping[k] /= is_first ? much : 2.0;
    if (ratio < 0.75 && m->turn[k] > 0.02 && m->damping[k] < 0.5 * m->need[k]) {
      m->damping[k] = 0.5 * m->need[k];
    }
    if (m->damping[k] < 1e-6 * m->largest_force / m->here.length[k]) {
      m->damping[k] = 0.0;
    }
  }
  m->shift *= 0.25;
  if (is_first) {
    m->part = m->part > 0.1 ? 0.5 * m->part : 0.0;
  }
}

/* Takes a step from coordinate, with more damping until the energy falls as it should; returns whether one did. */
static inline int member_take_step(
    double *coordinate, const equilibrium_arguments *arguments, scene_equilibrium_report *report,
    equilibrium_memory *m)
{
  int attempt, k;
  if (!member_locate_all(coordinate, arguments, &m->here)) {
    return 0;
  }
  m->longest = 0.0;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    m->longest = m->here.length[k] > m->longest ? m->here.length[k] : m->longest;
  }
  if (!m->is_started) {
    member_list_stiff(coordinate, arguments, m);
  }
  if (!member_balance(coordinate, arguments, m)) {
    return 0;
  }
  for (attempt = 0; attempt < MEMBER_ATTEMPTS; ++attempt) {
    double energy = NAN, damped = 0.0, undamped, saved, by_force = 0.0, turn;
    int is_known, is_rounding;
    if (!member_factor(m)) {
      return 0;
    }
    cholesky_solve(N, m->factor, m->force, m->step);
    is_known = member_follow(coordinate, arguments, m) && equilibrium_try(arguments, &energy, m)
        && member_locate_all(m->trial, arguments, &m->there);
    turn = member_find_turn(is_known, m);
    if (!is_known || turn > 1.0) {
      for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
        const double first = 0.1 * m->largest_force / m->here.length[k];
        if (m->turn[k] > 0.5 * (turn < 1.0 ? turn : 1.0)) {
          m->damping[k] = 4.0 * m->damping[k] > first ? 4.0 * m->damping[k] : first;
        }
      }
      continue;
    }
    for (k = 0; k < N; ++k) {
      damped += 0.5 * m->force[k] * m->step[k];
      by_force += 0.5 * (m->force[k] + m->trial_force[k]) * (m->trial[k] - coordinate[k]);
    }
    undamped = damped;
    for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
      const double apart = m->turn[k] * (m->here.length[k] > 0.1 * m->longest ? m->here.length[k] : 0.1 * m->longest);
      undamped += 0.5 * (m->damping[k] + m->part * m->compression[k]) * apart * apart;
    }
    is_rounding = undamped <= 1e-11 * (fabs(report->potential_energy) + m->largest_force * m->longest);
    saved = is_rounding ? by_force : report->potential_energy - energy;
    member_find_need(m);
    if (saved >= 0.1 * damped || (is_rounding && largest_entry(m->trial_force) < 0.9 * report->residual)) {
      report->shifted += undamped > damped;
      member_relax(saved / undamped, turn, attempt == 0, m);
      equilibrium_accept(coordinate, energy, report, m);
      return 1;
    }
    member_refuse(attempt >= 8, m);
  }
  return 0;
}
#endif
#endif

#endif
