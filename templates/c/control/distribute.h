#ifndef DISTRIBUTE_H
#define DISTRIBUTE_H
#include "distribution_memory.h"
#include "memory.h"
#include "quadratic_program.h"

/* Tensions that give the forces which feedback asks for, above the least ones and near preferred ones:
 *
 *     least |A (T - asked)|^2 + eps |T - preferred|^2     over the inputs of the actuators
 *     T = (k + EA / rho) (l - rho)                        of the driven members, also below zero
 *
 * by Gauss-Newton steps, or in one step where each actuator pulls one member. Bounds are exact in the inputs. Driven
 * members are those that actuators pull. */

#if WITH_FLOAT
#define DISTRIBUTION_SAME (real)1e-6      /* [m] */
#define DISTRIBUTION_TOLERANCE (real)1e-5 /* of bounds, over the largest tension */
#else
#define DISTRIBUTION_SAME (real)1e-9       /* [m] */
#define DISTRIBUTION_TOLERANCE (real)1e-12 /* of bounds, over the largest tension */
#endif
#define DISTRIBUTION_LONGEST (real)100.0 /* rest length over length, up to which tensions are counted with */
#define DISTRIBUTION_FORCE (real)1e-3    /* part of the tensions, by which forces may differ from those asked for */
#define DISTRIBUTION_SMALLEST (real)1e-9 /* part of eps, for inputs that change no tension */

/* What a sample asks for. */
typedef struct {
  const real *coordinate;   /* N_Q, true or estimated */
  const real *wanted;       /* N_U, inputs that feedback asks for [m] */
  const real *low, *high;   /* N_U, bounds of the next command by rates and ranges [m] */
  const real *least, *most; /* N_U, bounds of the inputs by ranges [m] */
} distribution_sample;

static inline real distribution_clip(real value, real low, real high)
{
  const real kept = value == value ? value : (real)0.5 * (low + high);
  return kept < low ? low : kept > high ? high : kept;
}

/* Rest length of a driven member for inputs of the actuators. */
static inline real distribution_rest(int e, const real *input, const scene_control_distribution *m)
{
  real rest = m->base[e];
  int p;
  for (p = DRIVEN_START[e]; p < DRIVEN_START[e + 1]; ++p) {
    rest += input[DRIVEN_PULL[p]];
  }
  return rest;
}

/* Tensions of the driven members for inputs of the actuators, and their derivatives by rest lengths. */
static inline void distribution_tension(
    const real *input, real *tension, real *slope, const scene_control_distribution *m)
{
  int e;
  for (e = 0; e < N_DRIVEN; ++e) {
    const real length = m->length[DRIVEN_MEMBER[e]], rest = distribution_rest(e, input, m);
    const real axial = AXIAL_STIFFNESS[e] / rest;
    tension[e] = (SPRING_CONSTANT[e] + axial) * (length - rest);
    if (slope != NULL) {
      slope[e] = -(SPRING_CONSTANT[e] + axial * length / rest);
    }
  }
}

/* Lengths, and the columns of the equilibrium matrix of driven members; returns whether they are finite. */
static inline int distribution_set_geometry(const distribution_sample *s, scene_control_distribution *m)
{
  real sum = (real)0.0;
  int k;
  if (control_geometry(s->coordinate, m->length, m->entry)) {
    return 0;
  }
  m->largest = (real)0.0;
  for (k = 0; k < N_EQUILIBRIUM; ++k) {
    const real size = program_size(m->entry[k]);
    sum += size * size;
    m->largest = size > m->largest ? size : m->largest;
  }
  m->mean_root = program_root(sum / (real)(N_Q * N_MEMBERS));
  m->mean_root = m->mean_root > (real)1e-18 ? m->mean_root : (real)1e-18;
  for (k = 0; k < N_Q * N_DRIVEN; ++k) {
    m->equilibrium[k] = (real)0.0;
  }
  for (k = 0; k < N_EQUILIBRIUM; ++k) {
    if (EQUILIBRIUM_PLACE[k] >= 0) {
      m->equilibrium[EQUILIBRIUM_PLACE[k]] = m->entry[k];
    }
  }
  return sum - sum == (real)0.0;
}

/* Upper bounds of inputs, and of the sums of inputs of members that several actuators pull. */
static inline void distribution_limit(const distribution_sample *s, scene_control_distribution *m)
{
  int e, k, shared = 0;
  for (k = 0; k < N_U; ++k) {
    m->top[k] = s->high[k];
  }
  for (e = 0; e < N_DRIVEN; ++e) {
    const int first = DRIVEN_START[e], count = DRIVEN_START[e + 1] - first;
    const real length = m->length[DRIVEN_MEMBER[e]], least = LEAST_TENSION[e], axial = AXIAL_STIFFNESS[e];
    real longest, shortest = (real)0.0;
    m->yields[e] = 0;
    if (!IS_LIMITED[e]) {
      continue;
    }
    longest = axial > (real)0.0 ? axial * length / (axial + least) : length - least / SPRING_CONSTANT[e];
    longest -= m->base[e];
    for (k = first; k < first + count; ++k) {
      shortest += s->low[DRIVEN_PULL[k]];
    }
    m->yields[e] = longest < shortest - DISTRIBUTION_SAME;
    longest = longest < shortest ? shortest : longest;
    if (count > 1) {
      m->shared_top[shared++] = longest;
    } else {
      real *top = m->top + DRIVEN_PULL[first];
      *top = longest < *top ? longest : *top;
    }
  }
}

/* Sizes of the inputs, of which the unknowns x of the program are multiples, and how tensions change with x. */
static inline void distribution_scale(scene_control_distribution *m)
{
  real largest = (real)0.0;
  int k, p;
  for (k = 0; k < N_U; ++k) {
    real sum = (real)0.0;
    for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
      sum += m->slope[PULL_DRIVEN[p]] * m->slope[PULL_DRIVEN[p]];
    }
    m->size[k] = program_root(sum);
    largest = m->size[k] > largest ? m->size[k] : largest;
  }
  for (k = 0; k < N_U; ++k) {
    m->size[k] = m->size[k] > (real)0.0 ? m->size[k] : largest > (real)1.0 ? largest : (real)1.0;
    for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
      m->part[p] = m->slope[PULL_DRIVEN[p]] / m->size[k];
    }
  }
}

/* Matrix of the program: how forces change with x, and, where members are pulled by several actuators, tensions. */
static inline void distribution_build(scene_control_distribution *m)
{
  scene_control_program *program = &m->program;
  int i, k, p;
  for (i = 0; i < N_ROWS * N_U; ++i) {
    program->matrix[i] = (real)0.0;
  }
  for (k = 0; k < N_U; ++k) {
    for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
      const int e = PULL_DRIVEN[p];
      for (i = 0; i < N_Q; ++i) {
        program->matrix[i * N_U + k] += m->equilibrium[i * N_DRIVEN + e] * m->part[p] / m->mean_root;
      }
      if (IS_COUPLED) {
        program->matrix[(N_Q + e) * N_U + k] += WEIGHT_ROOT[0] * m->part[p];
      }
    }
  }
}

/* What the program's matrix times x should be. */
static inline void distribution_set_target(real bottom, scene_control_distribution *m)
{
  scene_control_program *program = &m->program;
  int e, i, k, p;
  for (i = 0; i < N_Q; ++i) {
    const real *row = m->equilibrium + i * N_DRIVEN;
    real missing = (real)0.0;
    for (e = 0; e < N_DRIVEN; ++e) {
      missing += row[e] * (m->asked[e] - m->tension[e]);
    }
    program->target[i] = missing / m->mean_root;
  }
  for (k = 0; k < N_U; ++k) {
    real sum = (real)0.0;
    if (!IS_COUPLED) {
      for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
        e = PULL_DRIVEN[p];
        sum += m->part[p] * (m->preferred[e] - m->tension[e]);
      }
    }
    program->target[N_ROWS + k] = sum * WEIGHT_ROOT[0] * WEIGHT_ROOT[0] / bottom;
  }
  for (i = N_Q; i < N_ROWS; ++i) {
    program->target[i] = WEIGHT_ROOT[0] * (m->preferred[i - N_Q] - m->tension[i - N_Q]);
  }
}

/* Change at which the line that stands for a tension about a command has the tension of an input. Where each actuator
 * pulls one member, changes stand for tensions, so that lines and bounds are exact. */
static inline real distribution_to_change(int k, real input, const real *command, const scene_control_distribution *m)
{
  const int e = PULL_DRIVEN[PULL_START[k]];
  const real length = m->length[DRIVEN_MEMBER[e]];
  real rest = m->base[e] + input, tension;
  if (!IS_FIXED || !(m->slope[e] < (real)0.0)) {
    return input - command[k];
  }
  if (!(rest > (real)0.0)) {
    return -DAQP_INF;
  }
  rest = rest < DISTRIBUTION_LONGEST * length ? rest : DISTRIBUTION_LONGEST * length;
  tension = (SPRING_CONSTANT[e] + AXIAL_STIFFNESS[e] / rest) * (length - rest);
  return (tension - m->tension[e]) / m->slope[e];
}

/* Input that has the tension of a change. */
static inline real distribution_to_input(int k, real change, real command, const scene_control_distribution *m)
{
  const int e = PULL_DRIVEN[PULL_START[k]];
  const real length = m->length[DRIVEN_MEMBER[e]], axial = AXIAL_STIFFNESS[e];
  const real tension = m->tension[e] + m->slope[e] * change;
  if (!IS_FIXED || !(m->slope[e] < (real)0.0)) {
    return command + change;
  }
  return (axial > (real)0.0 ? axial * length / (axial + tension) : length - tension / SPRING_CONSTANT[e]) - m->base[e];
}

/* Bounds of x about a command. */
static inline void distribution_bound(const distribution_sample *s, const real *command, scene_control_distribution *m)
{
  scene_control_program *program = &m->program;
  int e, k, p, shared = 0;
  for (k = 0; k < N_U; ++k) {
    program->lower[k] = distribution_to_change(k, s->low[k], command, m) * m->size[k];
    program->upper[k] = distribution_to_change(k, m->top[k], command, m) * m->size[k];
  }
  for (e = 0; e < N_DRIVEN && N_SHARED > 0; ++e) {
    real *row = program->sum + shared * N_U;
    real moved = (real)0.0;
    if (!IS_LIMITED[e] || DRIVEN_START[e + 1] - DRIVEN_START[e] < 2) {
      continue;
    }
    for (k = 0; k < N_U; ++k) {
      row[k] = (real)0.0;
    }
    for (p = DRIVEN_START[e]; p < DRIVEN_START[e + 1]; ++p) {
      row[DRIVEN_PULL[p]] = (real)1.0 / m->size[DRIVEN_PULL[p]];
      moved += command[DRIVEN_PULL[p]];
    }
    program->lower[N_U + shared] = -DAQP_INF;
    program->upper[N_U + shared] =
        (m->shared_top[shared] - moved) * program_make_unit(row, N_U);
    ++shared;
  }
}

/* One Gauss-Newton step; returns whether it was found, and *moved, the largest change [m]. */
static inline int distribution_step(
    int pass, const distribution_sample *s, real *command, real *moved, program_solver *solver,
    scene_control_distribution *m)
{
  const int is_first = pass == 0 || !IS_FIXED;
  const real rest = DISTRIBUTION_SMALLEST + (IS_COUPLED ? (real)0.0 : (real)1.0);
  const real bottom = WEIGHT_ROOT[0] * program_root(rest);
  int k;
  distribution_tension(command, m->tension, m->slope, m);
  distribution_scale(m);
  if (is_first) {
    distribution_build(m);
    program_factor(bottom, &m->program);
  }
  distribution_set_target(bottom, m);
  distribution_bound(s, command, m);
  if (!program_solve(is_first, solver, &m->program)) {
    return 0;
  }
  *moved = (real)0.0;
  for (k = 0; k < N_U; ++k) {
    const real change = m->program.x[k] / m->size[k];
    command[k] = distribution_clip(distribution_to_input(k, change, command[k], m), s->low[k], m->top[k]);
    *moved = program_size(change) > *moved ? program_size(change) : *moved;
  }
  return 1;
}

/* Status of a command that was found. */
static inline int distribution_judge(const distribution_sample *s, const real *command, scene_control_distribution *m)
{
  real missed = (real)0.0, largest = (real)0.0;
  int e, i, k, is_rated = 0, is_ranged = 0;
  distribution_tension(command, m->tension, NULL, m);
  for (e = 0; e < N_DRIVEN; ++e) {
    const real size = program_size(m->asked[e]);
    if (m->yields[e]) {
      return SCENE_CONTROL_LEAST_TENSION;
    }
    largest = size > largest ? size : largest;
  }
  for (i = 0; i < N_Q; ++i) {
    real force = (real)0.0;
    for (e = 0; e < N_DRIVEN; ++e) {
      force += m->equilibrium[i * N_DRIVEN + e] * (m->tension[e] - m->asked[e]);
    }
    missed = program_size(force) > missed ? program_size(force) : missed;
  }
  if (missed <= DISTRIBUTION_FORCE * m->largest * largest) {
    return SCENE_CONTROL_OK;
  }
  for (k = 0; k < N_U; ++k) {
    const real same = DISTRIBUTION_SAME;
    const int at_range = command[k] <= s->least[k] + same || command[k] >= s->most[k] - same;
    is_rated |= !at_range && (command[k] <= s->low[k] + same || command[k] >= s->high[k] - same);
    is_ranged |= at_range;
  }
  if (is_rated) {
    return SCENE_CONTROL_RATE_LIMITED;
  }
  return is_ranged ? SCENE_CONTROL_RANGE_LIMITED : SCENE_CONTROL_TENSION_LIMITED;
}

/* The command of a sample, within low and high whatever happens, and its status. m->base and m->preferred are set. */
static inline int distribution_find(const distribution_sample *s, real *command, scene_control_distribution *m)
{
  real moved = (real)0.0, largest = (real)1.0;
  program_solver solver;
  int e, k, pass, is_found = distribution_set_geometry(s, m);
  m->program.iterations = m->iterations = 0;
  if (is_found) {
    distribution_limit(s, m);
    distribution_tension(s->wanted, m->asked, NULL, m);
    for (k = 0; k < N_U; ++k) {
      command[k] = distribution_clip(s->wanted[k], s->low[k], m->top[k]);
    }
    for (e = 0; e < N_DRIVEN; ++e) {
      largest = program_size(m->asked[e]) > largest ? program_size(m->asked[e]) : largest;
    }
    m->program.tolerance = DISTRIBUTION_TOLERANCE * largest;
  } else {
    for (e = 0; e < N_DRIVEN; ++e) {
      m->yields[e] = 0;
    }
  }
  for (pass = 0; is_found && pass < QP_PASSES; ++pass) {
    is_found = distribution_step(pass, s, command, &moved, &solver, m);
    if (moved < DISTRIBUTION_SAME) {
      break;
    }
  }
  m->iterations = m->program.iterations;
  if (is_found) {
    return distribution_judge(s, command, m);
  }
  for (k = 0; k < N_U; ++k) {
    command[k] = distribution_clip(s->wanted[k], s->low[k], s->high[k]);
  }
  return SCENE_CONTROL_NOT_SOLVED;
}

#endif
