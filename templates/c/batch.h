#ifndef BATCH_H
#define BATCH_H
#include "finite.h"
#include "sample.h"

/* Integrations of several states side by side; arrays are [entry][lane]. */

/* An argument of all lanes: rows of the caller's, `stride` apart, the bytes before its field of motion_arguments, and
 * the same numbers over the lanes. */
typedef struct {
  const real *rows;
  int stride, size;
  size_t place;
  real *lanes;
} batch_argument;

/* The samples that a caller asks for, for every state of a batch, and the status of each. */
typedef struct {
  int n_batch;
  real *state;
  long long n_samples;
  const double *sample_time;
  real *sample_state;
  long long *n_sampled;
  int *status;
} batch_call;

/* The lanes that are taken, their arguments as rows and over the lanes, and memory for single rows. */
typedef struct {
  motion_arguments with[WIDTH];
  batch_argument argument[N_ARGUMENTS + 1];
  int source[WIDTH]; /* the lane itself, or a good one that stands in for one that is not there or has failed */
  int runs[WIDTH];
  real *row;
} motion_batch;

/* Lane k of [size][lane] as a row. */
static inline void motion_lane(const real *lanes, int size, int k, real *row)
{
  int j;
  for (j = 0; j < size; ++j) {
    row[j] = lanes[j * WIDTH + k];
  }
}

/* What the sources of all lanes have at `values`, rows that are `stride` apart, to [size][lane]. */
static inline void motion_spread(const motion_batch *m, const real *values, int stride, int size, real *lanes)
{
  int j, k;
  for (k = 0; k < WIDTH; ++k) {
    const real *row = values + (ptrdiff_t)m->source[k] * stride;
    for (j = 0; j < size; ++j) {
      lanes[j * WIDTH + k] = row[j];
    }
  }
}

/* to = take[lane] ? from : to. */
static inline void motion_blend(
    const real *TENSEGRITY_RESTRICT take, const real *TENSEGRITY_RESTRICT from, int size, real *TENSEGRITY_RESTRICT to)
{
  int j, k;
  for (j = 0; j < size; ++j) {
    for (k = 0; k < WIDTH; ++k) {
      const real a = from[j * WIDTH + k], b = to[j * WIDTH + k];
      to[j * WIDTH + k] = take[k] > (real)0.0 ? a : b;
    }
  }
}

/* Copy the states of the lanes that are good, and no others, to their rows; returns the first status that is not. */
static inline int motion_gather(const motion_batch *m, const real *lanes, const batch_call *call)
{
  int k, first = SCENE_OK;
  for (k = call->n_batch - 1; k >= 0; --k) {
    if (m->source[k] == k) {
      motion_lane(lanes, N_STATES, k, call->state + (ptrdiff_t)k * N_STATES);
    }
    first = call->status[k] != SCENE_OK ? call->status[k] : first;
  }
  return first;
}

/* Whether all that lane k takes is finite. */
static inline int motion_is_finite(const motion_batch *m, const real *state, int k)
{
  int e;
  for (e = 0; e < N_ARGUMENTS; ++e) {
    const batch_argument *a = m->argument + e;
    if (!all_finite(a->rows + (ptrdiff_t)k * a->stride, a->size)) {
      return 0;
    }
  }
  return all_finite(state + (ptrdiff_t)k * N_STATES, N_STATES);
}

/* Find out which lanes can run: those whose status is good and whose numbers are finite. The others get a source among
 * these, and the status of what they lack. Returns how many can. */
static inline int motion_find_sources(const batch_call *call, motion_batch *m)
{
  int e, k, first = -1, count = 0;
  for (k = 0; k < call->n_batch; ++k) {
    if (call->status[k] == SCENE_OK && !motion_is_finite(m, call->state, k)) {
      call->status[k] = SCENE_NON_FINITE_INPUT;
    }
    if (call->status[k] == SCENE_OK) {
      first = first < 0 ? k : first;
      ++count;
    }
  }
  for (k = 0; k < WIDTH; ++k) {
    m->source[k] = k < call->n_batch && call->status[k] == SCENE_OK ? k : first;
    m->runs[k] = m->source[k] == k;
    for (e = 0; e < N_ARGUMENTS && count > 0; ++e) {
      const real *row = m->argument[e].rows + (ptrdiff_t)m->source[k] * m->argument[e].stride;
      memcpy((char *)(m->with + k) + m->argument[e].place, &row, sizeof row);
    }
  }
  return count;
}

/* Lay out the memory that all need, from `work` on, and fill the arguments; returns where the rest begins. */
static inline real *motion_lay_out_batch(real *work, motion_batch *m)
{
  /* Lanes are read fastest where they fill a line of the cache. */
  real *at = work + (LINE - (size_t)work / sizeof(real) % LINE) % LINE;
  int e;
  for (e = 0; e < N_ARGUMENTS; ++e) {
    batch_argument *a = m->argument + e;
    a->lanes = at;
    motion_spread(m, a->rows, a->stride, a->size, at);
    at += a->size * WIDTH;
  }
  m->row = at;
  return at;
}

/* Whether a pointer is missing. */
static inline int motion_lacks_rows(const batch_call *call, const motion_batch *m)
{
  int e, lacks = call->state == NULL || call->n_sampled == NULL || call->status == NULL;
  for (e = 0; e < N_ARGUMENTS; ++e) {
    lacks = lacks || m->argument[e].rows == NULL;
  }
  return lacks || (call->n_samples > 0 && (call->sample_time == NULL || call->sample_state == NULL));
}

/* Whether so many states, with rows so far apart, are a batch. */
static inline int motion_is_batch(const batch_call *call, const motion_batch *m)
{
  int e, is_batch = call->n_batch >= 1 && call->n_batch <= WIDTH;
  for (e = 0; e < N_ARGUMENTS; ++e) {
    is_batch = is_batch && (m->argument[e].stride == 0 || m->argument[e].stride >= m->argument[e].size);
  }
  return is_batch;
}

/* Whether the numbers of samples that are filled are numbers. */
static inline int motion_counts_samples(const batch_call *call)
{
  int k, counts = 1;
  for (k = 0; k < call->n_batch; ++k) {
    counts = counts && call->n_sampled[k] >= 0;
  }
  return counts;
}

/* Where the samples of lane k go. */
static inline motion_samples motion_samples_of(const batch_call *call, int k)
{
  motion_samples to;
  to.count = call->n_samples;
  to.time = call->sample_time;
  to.state = call->sample_state + k * call->n_samples * N_STATES;
  to.n_filled = call->n_sampled + k;
  return to;
}

/* A function of one state, which registers do not have, lane by lane; the lanes that have ended get zeros. */
static inline void motion_each_lane(
    void (*function)(const real *, const real *, const motion_arguments *, real *), const motion_batch *m,
    const real *coordinate, const real *velocity, real *result)
{
  real *row = m->row;
  int i, j, k;
  for (k = 0; k < WIDTH; ++k) {
    if (m->source[k] != k) {
      continue;
    }
    for (j = 0; j < N; ++j) {
      row[2 * N + j] = (real)0.0;
    }
    if (m->runs[k]) {
      motion_lane(coordinate, N, k, row);
      motion_lane(velocity, N, k, row + N);
      function(row, row + N, m->with + k, row + 2 * N);
    }
    for (i = 0; i < WIDTH; ++i) {
      for (j = 0; j < N && m->source[i] == k; ++j) {
        result[j * WIDTH + i] = row[2 * N + j];
      }
    }
  }
}

/* The rates of whole states with internal ones, lane by lane likewise. */
static inline void motion_each_state(
    void (*function)(const real *, const real *, const motion_arguments *, real *), const motion_batch *m,
    const real *state, real *result)
{
  real *row = m->row;
  int i, j, k;
  for (k = 0; k < WIDTH; ++k) {
    if (m->source[k] != k) {
      continue;
    }
    for (j = 0; j < N_STATES; ++j) {
      row[N_STATES + j] = (real)0.0;
    }
    if (m->runs[k]) {
      motion_lane(state, N_STATES, k, row);
      function(row, row + N, m->with + k, row + N_STATES);
    }
    for (i = 0; i < WIDTH; ++i) {
      for (j = 0; j < N_STATES && m->source[i] == k; ++j) {
        result[j * WIDTH + i] = row[N_STATES + j];
      }
    }
  }
}

#endif
