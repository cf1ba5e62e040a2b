#ifndef MEMBER_STEPS_H
#define MEMBER_STEPS_H
#include "equilibrium_memory.h"

#if !WITH_FLOAT
#if WITH_MEMBERS
/* Steps of a search for an equilibrium that damp single members and keep the predicted lengths of stiff ones. Each
 * solves (K* + D^T S D + shift I) s = f. D s are the differences of the ends of members, S their damping. Steps lead
 * along curves on which stiff members have the lengths l + J s, J = dl/dq; K* is the Hessian of the energy along these,
 * the one for tensions t + dt with (J J^T) dt = J f. Vectors over the coordinates have a last entry 0, that of fixed
 * ends. */

static inline double larger(double a, double b)
{
  return a > b ? a : b;
}

/* Difference of the ends of a member, of a vector over the coordinates. */
static inline void member_difference(int member, const double *field, double *difference)
{
  const short *end = equilibrium_ends() + 6 * member;
  int k;
  for (k = 0; k < 3; ++k) {
    difference[k] = field[end[k]] - field[end[k + 3]];
  }
}

/* By how much a member becomes longer along a vector over the coordinates. */
static inline double member_elongation(const equilibrium_members *at, int member, const double *field)
{
  const double *unit = at->unit + 3 * member;
  double d[3];
  member_difference(member, field, d);
  return unit[0] * d[0] + unit[1] * d[1] + unit[2] * d[2];
}

/* Adds `size` times the direction of a member to its first end, and takes it from the other. */
static inline void member_pull(const equilibrium_members *at, int member, double size, double *field)
{
  const short *end = equilibrium_ends() + 6 * member;
  int k;
  for (k = 0; k < 3; ++k) {
    field[end[k]] += size * at->unit[3 * member + k];
    field[end[k + 3]] -= size * at->unit[3 * member + k];
  }
  field[N] = 0.0;
}

/* Direction and length of a member at m->trial. */
static inline void member_locate(
    int member, const equilibrium_arguments *arguments, const equilibrium_memory *m, equilibrium_members *at)
{
  double d[3], v[3];
  int k;
  equilibrium_fixed_part(arguments, member, v);
  member_difference(member, m->trial, d);
  for (k = 0; k < 3; ++k) {
    v[k] += d[k];
  }
  at->length[member] = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  for (k = 0; k < 3; ++k) {
    at->unit[3 * member + k] = at->length[member] > 0.0 ? v[k] / at->length[member] : 0.0;
  }
}

/* Members at m->trial; returns whether their tensions are finite. */
static inline int member_locate_all(
    const equilibrium_arguments *arguments, const equilibrium_memory *m, equilibrium_members *at)
{
  int k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    member_locate(k, arguments, m, at);
  }
  equilibrium_tension(m->trial, arguments, at->tension);
  return all_finite(at->tension, EQUILIBRIUM_MEMBERS);
}

/* Lists the stiff members, those above the widest gap of spring constants, if that is at least 10. A displacement of
 * m->trial shows these constants. None is listed where they are more than the coordinates. */
static inline void member_list_stiff(const equilibrium_arguments *arguments, equilibrium_memory *m)
{
  double *constant = m->need, widest = 10.0, limit = INFINITY;
  int i, k;
  for (k = 0; k < N; ++k) {
    m->trial[k] += 1e-6 * m->longest * sin(1.0 + 2.4 * k);
  }
  member_locate_all(arguments, m, &m->there);
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    /* mu = dt / dl */
    const double change = fabs(m->there.length[k] - m->here.length[k]);
    constant[k] = change > 1e-9 * m->longest ? fabs(m->there.tension[k] - m->here.tension[k]) / change : 0.0;
    m->damping[k] = 0.0;
  }
  /* The widest ratio of a constant to the next lower one. */
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
  m->shift = 0.0;
  m->is_started = 1;
}

/* Members at coordinate, factors of J J^T, and the tensions of stiff members that balance the forces best; returns
 * whether all of it is finite. */
static inline int member_balance(
    const double *coordinate, const equilibrium_arguments *arguments, equilibrium_memory *m)
{
  double pivot;
  int i, k;
  for (k = 0; k < N; ++k) {
    m->trial[k] = coordinate[k];
  }
  m->trial[N] = m->force[N] = m->step[N] = 0.0;
  if (!member_locate_all(arguments, m, &m->here)) {
    return 0;
  }
  m->longest = 0.0;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    m->longest = larger(m->longest, m->here.length[k]);
    m->density[k] = 0.0;
  }
  if (!m->is_started) {
    member_list_stiff(arguments, m);
  }
  for (i = 0; i < m->n_stiff; ++i) {
    for (k = 0; k < N; ++k) {
      m->step[k] = 0.0;
    }
    member_pull(&m->here, m->stiff[i], 1.0, m->step);
    for (k = 0; k <= i; ++k) {
      m->stiff_factor[i * m->n_stiff + k] = member_elongation(&m->here, m->stiff[k], m->step);
    }
    m->stiff_factor[i * (m->n_stiff + 1)] += 1e-10; /* for members that are redundant */
    m->gap[i] = member_elongation(&m->here, m->stiff[i], m->force);
  }
  if (!cholesky_factor(m->n_stiff, m->stiff_factor, &pivot)) {
    return 0;
  }
  cholesky_solve(m->n_stiff, m->stiff_factor, m->gap, m->gap);
  for (i = 0; i < m->n_stiff; ++i) {
    m->density[m->stiff[i]] = m->gap[i] / m->here.length[m->stiff[i]];
  }
  m->largest_force = 0.0;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    m->largest_force = larger(m->largest_force, fabs(m->here.tension[k] + m->density[k] * m->here.length[k]));
  }
  return 1;
}

/* Factors of K* with the damping, of which there is more until it is positive definite; returns whether it is. */
static inline int member_factor(equilibrium_memory *m)
{
  const double least = 4e-13 * largest_entry(m->weight); /* against rounding */
  double pivot;
  int count, i, k, member;
  for (count = 0; count < 60; ++count) {
    cholesky_fill(m->hessian, equilibrium_row(), equilibrium_column_start(), 0.0, m->weight, m->factor);
    for (member = 0; member < EQUILIBRIUM_MEMBERS; ++member) {
      const short *end = equilibrium_ends() + 6 * member;
      const double *unit = m->here.unit + 3 * member, density = m->density[member];
      const double even = density + m->damping[member];
      for (i = 0; i < 6 && (even != 0.0 || density != 0.0); ++i) {
        for (k = 0; k < 6; ++k) {
          const double block = (i % 3 == k % 3 ? even : 0.0) - density * unit[i % 3] * unit[k % 3];
          if (end[i] < N && end[k] <= end[i]) {
            m->factor[end[i] * N + end[k]] += i / 3 == k / 3 ? block : -block;
          }
        }
      }
    }
    for (k = 0; k < N; ++k) {
      m->factor[k * (N + 1)] += m->shift + least;
    }
    if (cholesky_factor(N, m->factor, &pivot)) {
      return 1;
    }
    m->shift = 4.0 * m->shift + 1e-3 * m->largest_force / m->longest + least;
  }
  return 0;
}

/* Sets m->trial to the end of the curve along m->step; returns whether stiff members find their lengths near it. */
static inline int member_follow(
    const double *coordinate, const equilibrium_arguments *arguments, equilibrium_memory *m)
{
  double worst = INFINITY, least = m->longest, apart = 0.0, size = 0.0, before;
  int count, i;
  for (i = 0; i < N; ++i) {
    m->trial[i] = coordinate[i] + m->step[i];
    least = larger(least, fabs(m->trial[i]));
  }
  least *= 2e-15; /* rounding of lengths */
  for (count = 0; count < 60; ++count) {
    before = worst;
    worst = 0.0;
    for (i = 0; i < m->n_stiff; ++i) {
      const int k = m->stiff[i];
      member_locate(k, arguments, m, &m->there);
      m->gap[i] = m->there.length[k] - m->here.length[k] - member_elongation(&m->here, k, m->step);
      worst = larger(worst, fabs(m->gap[i]));
    }
    if (worst <= 0.25 * least || (worst <= least && worst >= 0.5 * before)) {
      for (i = 0; i < N; ++i) {
        const double correction = m->trial[i] - coordinate[i] - m->step[i];
        apart += correction * correction;
        size += m->step[i] * m->step[i];
      }
      return apart <= size;
    }
    cholesky_solve(m->n_stiff, m->stiff_factor, m->gap, m->gap);
    for (i = 0; i < m->n_stiff; ++i) {
      member_pull(&m->here, m->stiff[i], -m->gap[i], m->trial);
    }
  }
  return 0;
}

/* Compares the energies of members along the step with their quadratic models: sets m->need to the damping that would
 * have covered the difference, and m->turn to how far their ends part as a share of the length. Returns the energy
 * that damping takes from the step. To second order a member with tension t, spring constant k, elongation e and
 * difference d of the ends has the energy t e + k e^2 / 2 + t (d^2 - e^2) / 2 l. */
static inline double member_compare(int is_known, equilibrium_memory *m)
{
  double damped = 0.0, d[3];
  int k;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double before = m->here.tension[k], after = m->there.tension[k], length = m->here.length[k];
    const double elongation = member_elongation(&m->here, k, m->step), change = m->there.length[k] - length;
    const double slope = fabs(change) > 1e-7 * length ? fabs((after - before) / change) : 0.0;
    double energy = 0.5 * (before + after) * change - before * elongation, square;
    member_difference(k, m->step, d);
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    energy -= 0.5 * (slope * elongation * elongation + before / length * (square - elongation * elongation));
    m->need[k] = energy > 0.0 && square > 1e-18 * length * length ? 2.0 * energy / square : 0.0;
    m->turn[k] = is_known && before == 0.0 && after == 0.0 ? 0.0 : sqrt(square) / larger(length, 0.1 * m->longest);
    damped += 0.5 * m->damping[k] * square;
  }
  for (k = 0; k < m->n_stiff; ++k) {
    m->need[m->stiff[k]] = 0.0; /* these have their lengths */
  }
  return damped;
}

/* Changes the damping after a step: less if it was taken, else more for members that turn by more than `far`, if that
 * is above 0, or as they need. */
static inline void member_change_damping(int is_taken, double far, equilibrium_memory *m)
{
  int k;
  m->shift *= is_taken ? 0.25 : 1.0;
  for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
    const double length = m->here.length[k] > 0.0 ? m->here.length[k] : 0.1 * m->longest;
    const double old = m->damping[k], need = m->need[k], unit = m->largest_force / length;
    if (is_taken) {
      m->damping[k] = old > 4e-6 * unit ? 0.25 * old : 0.0;
    } else if (far > 0.0) {
      m->damping[k] = m->turn[k] > far ? larger(4.0 * old, 0.1 * unit) : old;
    } else {
      m->damping[k] = larger(2.0 * old, sqrt(need * larger(old, need / 30.0)));
    }
  }
}

/* Takes a step from coordinate, with more damping until the energy falls as it should; returns whether one did. */
static inline int member_take_step(
    double *coordinate, const equilibrium_arguments *arguments, scene_equilibrium_report *report,
    equilibrium_memory *m)
{
  int attempt, is_taken = 0, k;
  if (!member_balance(coordinate, arguments, m)) {
    return 0;
  }
  for (attempt = 0; attempt < 40 && !is_taken && member_factor(m); ++attempt) {
    double energy = NAN, foreseen = 0.0, by_forces = 0.0, turn = 0.0, damped;
    int is_known, is_rounding;
    cholesky_solve(N, m->factor, m->force, m->step);
    is_known = member_follow(coordinate, arguments, m) && equilibrium_try(arguments, &energy, m)
        && member_locate_all(arguments, m, &m->there);
    damped = member_compare(is_known, m);
    for (k = 0; k < EQUILIBRIUM_MEMBERS; ++k) {
      turn = larger(turn, m->turn[k]);
    }
    for (k = 0; k < N; ++k) {
      foreseen += 0.5 * m->force[k] * m->step[k];
      by_forces += 0.5 * (m->force[k] + m->trial_force[k]) * (m->trial[k] - coordinate[k]);
    }
    /* Where the fall is less than the rounding of the energy, the forces tell it, or the residual has to fall. */
    is_rounding = foreseen + damped <= 1e-11 * (fabs(report->potential_energy) + m->largest_force * m->longest);
    is_known = is_known && turn <= 1.0;
    is_taken = is_known
        && ((is_rounding ? by_forces : report->potential_energy - energy) >= 0.1 * foreseen
            || (is_rounding && largest_entry(m->trial_force) < 0.9 * report->residual));
    if (is_taken) {
      report->shifted += damped > 0.0 || m->shift > 0.0;
      equilibrium_accept(coordinate, energy, report, m);
    }
    member_change_damping(is_taken, is_known && attempt < 8 ? 0.0 : 0.5 * (turn < 1.0 ? turn : 1.0), m);
  }
  return is_taken;
}
#endif
#endif

#endif
