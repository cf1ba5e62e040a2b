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
#define DISTRIBUTION_LENGTH_TOLERANCE (real)1e-6 /* [m], within which inputs are equal */
#define DISTRIBUTION_TOLERANCE (real)1e-5        /* of bounds, over the largest tension */
#else
#define DISTRIBUTION_LENGTH_TOLERANCE (real)1e-9 /* [m], within which inputs are equal */
#define DISTRIBUTION_TOLERANCE (real)1e-12       /* of bounds, over the largest tension */
#endif
#define DISTRIBUTION_MAX_REST_RATIO (real)100.0 /* rest length over length, up to which tensions are computed */
#define DISTRIBUTION_FORCE_TOLERANCE (real)1e-3 /* part of the tensions, by which forces may differ from the wanted */
#define DISTRIBUTION_MIN_WEIGHT (real)1e-9      /* part of eps, for inputs that change no tension */

/* What a sample asks for. */
typedef struct {
  const real *coordinate;             /* N_Q, true or estimated */
  const real *wanted;                 /* N_U, inputs that feedback asks for [m] */
  const real *low, *high;             /* N_U, bounds of the next command by rates and ranges [m] */
  const real *range_low, *range_high; /* N_U, bounds of the inputs by ranges alone [m] */
} distribution_sample;

/* A value within bounds; their middle for what is no number. */
static inline real distribution_clip(real value, real low, real high)
{
  const real number = value == value ? value : (real)0.5 * (low + high);
  return number < low ? low : number > high ? high : number;
}

/* Rest length of a driven member for inputs of the actuators. */
static inline real distribution_rest_length(int e, const real *input, const scene_control_distribution *m)
{
  real rest_length = m->base[e];
  int p;
  for (p = DRIVEN_START[e]; p < DRIVEN_START[e + 1]; ++p) {
    rest_length += input[DRIVEN_PULL[p]];
  }
  return rest_length;
}

/* Tensions of the driven members for inputs of the actuators, and their derivatives by rest lengths. */
static inline void distribution_tension(
    const real *input, real *tension, real *slope, const scene_control_distribution *m)
{
  int e;
  for (e = 0; e < N_DRIVEN; ++e) {
    const real length = m->length[DRIVEN_MEMBER[e]], rest_length = distribution_rest_length(e, input, m);
    const real stiffness = AXIAL_STIFFNESS[e] / rest_length;
    tension[e] = (SPRING_CONSTANT[e] + stiffness) * (length - rest_length);
    if (slope != NULL) {
      slope[e] = -(SPRING_CONSTANT[e] + stiffness * length / rest_length);
    }
  }
}

/* Set lengths, and the columns of the equilibrium matrix of driven members; returns whether they are finite. */
static inline int distribution_set_geometry(const distribution_sample *sample, scene_control_distribution *m)
{
  real sum_of_squares = (real)0.0;
  int k;
  if (control_geometry(sample->coordinate, m->length, m->entry)) {
    return 0;
  }
  /* Sizes of the entries. */
  m->largest = (real)0.0;
  for (k = 0; k < N_EQUILIBRIUM; ++k) {
    const real size = program_size(m->entry[k]);
    sum_of_squares += size * size;
    m->largest = size > m->largest ? size : m->largest;
  }
  m->mean_root = program_root(sum_of_squares / (real)(N_Q * N_MEMBERS));
  m->mean_root = m->mean_root > (real)1e-18 ? m->mean_root : (real)1e-18;
  /* The columns of driven members, as a full matrix. */
  for (k = 0; k < N_Q * N_DRIVEN; ++k) {
    m->equilibrium[k] = (real)0.0;
  }
  for (k = 0; k < N_EQUILIBRIUM; ++k) {
    if (EQUILIBRIUM_PLACE[k] >= 0) {
      m->equilibrium[EQUILIBRIUM_PLACE[k]] = m->entry[k];
    }
  }
  return sum_of_squares - sum_of_squares == (real)0.0;
}

/* Set upper bounds of inputs, and of the sums of inputs of members that several actuators pull, by which members have
 * their least tensions; a least tension that rates and ranges do not permit yields. */
static inline void distribution_set_upper_bounds(const distribution_sample *sample, scene_control_distribution *m)
{
  int e, k, n_shared = 0;
  for (k = 0; k < N_U; ++k) {
    m->top[k] = sample->high[k];
  }
  for (e = 0; e < N_DRIVEN; ++e) {
    const int first = DRIVEN_START[e], count = DRIVEN_START[e + 1] - first;
    const real length = m->length[DRIVEN_MEMBER[e]], least_tension = LEAST_TENSION[e],
               axial_stiffness = AXIAL_STIFFNESS[e];
    real largest_input, smallest_input = (real)0.0;
    m->yields[e] = 0;
    if (!IS_LIMITED[e]) {
      continue;
    }
    /* The largest change of the rest length that leaves the least tension. */
    largest_input = axial_stiffness > (real)0.0 ? axial_stiffness * length / (axial_stiffness + least_tension)
                                                : length - least_tension / SPRING_CONSTANT[e];
    largest_input -= m->base[e];
    for (k = first; k < first + count; ++k) {
      smallest_input += sample->low[DRIVEN_PULL[k]];
    }
    /* It yields where the lower bounds of the inputs exceed it. */
    m->yields[e] = largest_input < smallest_input - DISTRIBUTION_LENGTH_TOLERANCE;
    largest_input = largest_input < smallest_input ? smallest_input : largest_input;
    if (count > 1) {
      m->shared_top[n_shared++] = largest_input;
    } else {
      real *top = m->top + DRIVEN_PULL[first];
      *top = largest_input < *top ? largest_input : *top;
    }
  }
}

/* Set sizes of the inputs, of which the unknowns x of the program are multiples, and how tensions change with x. */
static inline void distribution_set_sizes(scene_control_distribution *m)
{
  real largest = (real)0.0;
  int k, p;
  for (k = 0; k < N_U; ++k) {
    real sum_of_squares = (real)0.0;
    for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
      sum_of_squares += m->slope[PULL_DRIVEN[p]] * m->slope[PULL_DRIVEN[p]];
    }
    m->size[k] = program_root(sum_of_squares);
    largest = m->size[k] > largest ? m->size[k] : largest;
  }
  for (k = 0; k < N_U; ++k) {
    m->size[k] = m->size[k] > (real)0.0 ? m->size[k] : largest > (real)1.0 ? largest : (real)1.0;
    for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
      m->part[p] = m->slope[PULL_DRIVEN[p]] / m->size[k];
    }
  }
}

/* Set the matrix of the program: how forces change with x, and tensions where several actuators pull a member. */
static inline void distribution_build_matrix(scene_control_distribution *m)
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

/* Set what the program's matrix times x should be; weight: the multiple of the unit matrix below its own rows. */
static inline void distribution_set_target(real weight, scene_control_distribution *m)
{
  scene_control_program *program = &m->program;
  int e, i, k, p;
  /* Forces that are missing. */
  for (i = 0; i < N_Q; ++i) {
    const real *row = m->equilibrium + i * N_DRIVEN;
    real missing = (real)0.0;
    for (e = 0; e < N_DRIVEN; ++e) {
      missing += row[e] * (m->asked[e] - m->tension[e]);
    }
    program->target[i] = missing / m->mean_root;
  }
  /* Preferred tensions, where each actuator pulls members of its own. */
  for (k = 0; k < N_U; ++k) {
    real sum = (real)0.0;
    if (!IS_COUPLED) {
      for (p = PULL_START[k]; p < PULL_START[k + 1]; ++p) {
        e = PULL_DRIVEN[p];
        sum += m->part[p] * (m->preferred[e] - m->tension[e]);
      }
    }
    program->target[N_ROWS + k] = sum * WEIGHT_ROOT[0] * WEIGHT_ROOT[0] / weight;
  }
  /* Preferred tensions, where actuators share members. */
  for (i = N_Q; i < N_ROWS; ++i) {
    program->target[i] = WEIGHT_ROOT[0] * (m->preferred[i - N_Q] - m->tension[i - N_Q]);
  }
}

/* Change of input k, from the command, at which the tangent of its tension has the tension of `input`. Where each
 * actuator pulls one member, changes stand for tensions, so that tangents and bounds are exact. */
static inline real distribution_to_change(int k, real input, const real *command, const scene_control_distribution *m)
{
  const int e = PULL_DRIVEN[PULL_START[k]];
  const real length = m->length[DRIVEN_MEMBER[e]];
  real rest_length = m->base[e] + input, tension;
  if (!IS_FIXED || !(m->slope[e] < (real)0.0)) {
    return input - command[k];
  }
  if (!(rest_length > (real)0.0)) {
    return -DAQP_INF;
  }
  rest_length = rest_length < DISTRIBUTION_MAX_REST_RATIO * length ? rest_length : DISTRIBUTION_MAX_REST_RATIO * length;
  tension = (SPRING_CONSTANT[e] + AXIAL_STIFFNESS[e] / rest_length) * (length - rest_length);
  return (tension - m->tension[e]) / m->slope[e];
}

/* Input whose tension is that of the tangent at a change from the command; the inverse of distribution_to_change. */
static inline real distribution_to_input(int k, real change, real command, const scene_control_distribution *m)
{
  const int e = PULL_DRIVEN[PULL_START[k]];
  const real length = m->length[DRIVEN_MEMBER[e]], axial_stiffness = AXIAL_STIFFNESS[e];
  const real tension = m->tension[e] + m->slope[e] * change;
  if (!IS_FIXED || !(m->slope[e] < (real)0.0)) {
    return command + change;
  }
  return (axial_stiffness > (real)0.0 ? axial_stiffness * length / (axial_stiffness + tension)
                                      : length - tension / SPRING_CONSTANT[e])
      - m->base[e];
}

/* Set bounds of x about a command, and of the sums of inputs of members that several actuators pull. */
static inline void distribution_set_bounds(
    const distribution_sample *sample, const real *command, scene_control_distribution *m)
{
  scene_control_program *program = &m->program;
  int e, k, p, n_shared = 0;
  for (k = 0; k < N_U; ++k) {
    program->lower[k] = distribution_to_change(k, sample->low[k], command, m) * m->size[k];
    program->upper[k] = distribution_to_change(k, m->top[k], command, m) * m->size[k];
  }
  for (e = 0; e < N_DRIVEN && N_SHARED > 0; ++e) {
    real *row = program->sum + n_shared * N_U;
    real present = (real)0.0;
    if (!IS_LIMITED[e] || DRIVEN_START[e + 1] - DRIVEN_START[e] < 2) {
      continue;
    }
    for (k = 0; k < N_U; ++k) {
      row[k] = (real)0.0;
    }
    for (p = DRIVEN_START[e]; p < DRIVEN_START[e + 1]; ++p) {
      row[DRIVEN_PULL[p]] = (real)1.0 / m->size[DRIVEN_PULL[p]];
      present += command[DRIVEN_PULL[p]];
    }
    program->lower[N_U + n_shared] = -DAQP_INF;
    program->upper[N_U + n_shared] =
        (m->shared_top[n_shared] - present) * program_make_unit(row, N_U);
    ++n_shared;
  }
}

/* One Gauss-Newton step of the command; returns whether it was found, and *largest_change [m] of an input. */
static inline int distribution_step(
    int pass, const distribution_sample *sample, real *command, real *largest_change, program_solver *solver,
    scene_control_distribution *m)
{
  const int is_first = pass == 0 || !IS_FIXED;
  const real least_weight = DISTRIBUTION_MIN_WEIGHT + (IS_COUPLED ? (real)0.0 : (real)1.0);
  const real weight = WEIGHT_ROOT[0] * program_root(least_weight);
  int k;
  /* The program about the command. */
  distribution_tension(command, m->tension, m->slope, m);
  distribution_set_sizes(m);
  if (is_first) {
    distribution_build_matrix(m);
    program_factor(weight, &m->program);
  }
  distribution_set_target(weight, m);
  distribution_set_bounds(sample, command, m);
  if (!program_solve(is_first, solver, &m->program)) {
    return 0;
  }
  /* The command that its solution stands for. */
  *largest_change = (real)0.0;
  for (k = 0; k < N_U; ++k) {
    const real change = m->program.x[k] / m->size[k];
    command[k] = distribution_clip(distribution_to_input(k, change, command[k], m), sample->low[k], m->top[k]);
    *largest_change = program_size(change) > *largest_change ? program_size(change) : *largest_change;
  }
  return 1;
}

/* Status of a command that was found. */
static inline int distribution_find_status(
    const distribution_sample *sample, const real *command, scene_control_distribution *m)
{
  real force_error = (real)0.0, largest_tension = (real)0.0;
  int e, i, k, is_rate_limited = 0, is_range_limited = 0;
  distribution_tension(command, m->tension, NULL, m);
  /* A least tension that yields comes first. */
  for (e = 0; e < N_DRIVEN; ++e) {
    const real size = program_size(m->asked[e]);
    if (m->yields[e]) {
      return SCENE_CONTROL_LEAST_TENSION;
    }
    largest_tension = size > largest_tension ? size : largest_tension;
  }
  /* By how much the forces miss those that feedback asks for. */
  for (i = 0; i < N_Q; ++i) {
    real force = (real)0.0;
    for (e = 0; e < N_DRIVEN; ++e) {
      force += m->equilibrium[i * N_DRIVEN + e] * (m->tension[e] - m->asked[e]);
    }
    force_error = program_size(force) > force_error ? program_size(force) : force_error;
  }
  if (force_error <= DISTRIBUTION_FORCE_TOLERANCE * m->largest * largest_tension) {
    return SCENE_CONTROL_OK;
  }
  /* What keeps the command from it: a rate, a range, or else a tension. */
  for (k = 0; k < N_U; ++k) {
    const real tolerance = DISTRIBUTION_LENGTH_TOLERANCE;
    const int at_range =
        command[k] <= sample->range_low[k] + tolerance || command[k] >= sample->range_high[k] - tolerance;
    is_rate_limited |=
        !at_range && (command[k] <= sample->low[k] + tolerance || command[k] >= sample->high[k] - tolerance);
    is_range_limited |= at_range;
  }
  if (is_rate_limited) {
    return SCENE_CONTROL_RATE_LIMITED;
  }
  return is_range_limited ? SCENE_CONTROL_RANGE_LIMITED : SCENE_CONTROL_TENSION_LIMITED;
}

/* The command of a sample, within low and high whatever happens, and its status. m->base and m->preferred are set. */
static inline int distribution_find(const distribution_sample *sample, real *command, scene_control_distribution *m)
{
  real largest_change = (real)0.0, largest_tension = (real)1.0;
  program_solver solver;
  int e, k, pass, is_found = distribution_set_geometry(sample, m);
  m->program.iterations = m->iterations = 0;
  /* Bounds, the tensions that feedback asks for, and its inputs within the bounds as a start. */
  if (is_found) {
    distribution_set_upper_bounds(sample, m);
    distribution_tension(sample->wanted, m->asked, NULL, m);
    for (k = 0; k < N_U; ++k) {
      command[k] = distribution_clip(sample->wanted[k], sample->low[k], m->top[k]);
    }
    for (e = 0; e < N_DRIVEN; ++e) {
      largest_tension = program_size(m->asked[e]) > largest_tension ? program_size(m->asked[e]) : largest_tension;
    }
    m->program.tolerance = DISTRIBUTION_TOLERANCE * largest_tension;
  } else {
    for (e = 0; e < N_DRIVEN; ++e) {
      m->yields[e] = 0;
    }
  }
  /* Gauss-Newton steps until the command stays where it is. */
  for (pass = 0; is_found && pass < QP_PASSES; ++pass) {
    is_found = distribution_step(pass, sample, command, &largest_change, &solver, m);
    if (largest_change < DISTRIBUTION_LENGTH_TOLERANCE) {
      break;
    }
  }
  m->iterations = m->program.iterations;
  if (is_found) {
    return distribution_find_status(sample, command, m);
  }
  /* Without a solution: the inputs of feedback within rates and ranges. */
  for (k = 0; k < N_U; ++k) {
    command[k] = distribution_clip(sample->wanted[k], sample->low[k], sample->high[k]);
  }
  return SCENE_CONTROL_NOT_SOLVED;
}

#endif
