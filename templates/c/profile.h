#ifndef PROFILE_H
#define PROFILE_H
#include "run.h"
#if WITH_PROFILE

/* The arguments of one integration that follow a profile, and where the integration stands in it. */
typedef struct {
  const scene_profile *knots;
  long long piece;     /* the piece that was used last */
  long long low, high; /* pieces low to high - 1 lie between the two kinks that the motion is between; high < 0: not
                        * known yet */
  double start;        /* time at which the step starts that is tried */
  real *value;         /* all arguments that can change, one after the other */
} motion_profile;

/* Give the arguments their values at a time. Up to the next kink the polynomials before it hold. p: NULL where all
 * arguments are constant. */
static inline void profile_set_time(double time, motion_profile *p)
{
  const scene_profile *knots;
  const double *row;
  double since;
  int i, j, n;
  if (p == NULL) {
    return;
  }
  knots = p->knots;
  while (p->piece + 1 < p->high && time >= knots->time[p->piece + 1]) {
    ++p->piece;
  }
  while (p->piece > p->low && time < knots->time[p->piece]) {
    --p->piece;
  }
  since = time - knots->time[p->piece];
  n = knots->n_values;
  row = knots->coefficient + p->piece * (knots->degree + 1) * n;
  for (j = 0; j < n; ++j) {
    double value = row[knots->degree * n + j];
    for (i = knots->degree - 1; i >= 0; --i) {
      value = row[i * n + j] + since * value;
    }
    p->value[knots->place[j]] = (real)value;
  }
}

/* Rate of the j-th number that changes, on the piece that was used last. */
static inline double profile_rate(double time, int j, const motion_profile *p)
{
  const scene_profile *knots = p->knots;
  const double *row = knots->coefficient + p->piece * (knots->degree + 1) * knots->n_values;
  double rate = 0.0;
  int k;
  for (k = knots->degree; k > 0; --k) {
    rate = k * row[k * knots->n_values + j] + (time - knots->time[p->piece]) * rate;
  }
  return rate;
}

/* Say at which time a step starts. */
static inline void profile_set_start(double time, motion_profile *p)
{
  if (p != NULL) {
    p->start = time;
  }
}

/* Give the arguments their values at a time `later` than the start of the step. */
static inline void profile_set_stage(double later, motion_profile *p)
{
  if (p != NULL) {
    profile_set_time(p->start + later, p);
  }
}

/* Time of the next kink; INFINITY where there is none. */
static inline double profile_kink(const motion_profile *p)
{
  return p != NULL && p->high < p->knots->n_pieces ? p->knots->time[p->high] : INFINITY;
}

/* Enter the pieces between kinks that begin at a time, or hold it. */
static inline void profile_enter(double time, motion_profile *p)
{
  const scene_profile *knots = p->knots;
  long long high = knots->n_pieces;
  p->low = 0;
  while (high - p->low > 1) {
    const long long middle = p->low + (high - p->low) / 2;
    if (time >= knots->time[middle]) {
      p->low = middle;
    } else {
      high = middle;
    }
  }
  while (high < knots->n_pieces && knots->is_kink != NULL && !knots->is_kink[high]) {
    ++high;
  }
  p->high = high;
  p->piece = p->low;
  profile_set_time(time, p);
}

/* Whether an integration from `time` to `time_end` can follow these knots; n_driven: numbers that can change; all
 * knots are looked at in its first call only. */
static inline int profile_check(
    const scene_profile *knots, int n_driven, int is_first, double time, double time_end)
{
  const long long n = is_first ? knots->n_pieces : 0;
  long long k;
  int j;
  if (knots->place == NULL || knots->time == NULL || knots->coefficient == NULL) {
    return SCENE_NULL_POINTER;
  }
  if (knots->n_pieces < 1 || knots->degree < 0 || knots->n_values < 0 || !(time >= knots->time[0])
      || !(time_end <= knots->time[knots->n_pieces])) {
    return SCENE_INVALID_ARGUMENT;
  }
  for (j = 0; j < knots->n_values; ++j) {
    if (knots->place[j] < 0 || knots->place[j] >= n_driven) {
      return SCENE_INVALID_ARGUMENT;
    }
  }
  for (k = 0; k < n; ++k) {
    if (!(knots->time[k + 1] > knots->time[k])) {
      return SCENE_INVALID_ARGUMENT;
    }
  }
  for (k = 0; k < n * (knots->degree + 1) * knots->n_values; ++k) {
    if (!(knots->coefficient[k] - knots->coefficient[k] == 0.0)) {
      return SCENE_NON_FINITE_INPUT;
    }
  }
  return SCENE_OK;
}

/* Begin, or continue, to follow these knots; value: memory for the arguments. */
static inline void profile_begin(const scene_profile *knots, real *value, motion_profile *p)
{
  p->knots = knots;
  p->value = value;
  p->piece = 0;
  p->low = 0;
  p->high = -1;
  p->start = 0.0;
}

/* Start from the constant value of one argument, (count,); returns where its values stand from now on. */
static inline const real *profile_copy(const real *constant, int count, int place, motion_profile *p)
{
  int k;
  for (k = 0; k < count; ++k) {
    p->value[place + k] = constant[k];
  }
  return p->value + place;
}

#endif

#endif
