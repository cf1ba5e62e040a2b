/* Sample of what the generator writes for the integrator radau: one two-sided member, from the first node to an
 * anchor. */
#ifndef RADAU_CONFIG_H
#define RADAU_CONFIG_H
#include "config.h"

enum {
  N_TENSIONS = 1,              /* members whose tensions are unknowns, multipliers of their laws */
  TENSION_ROOM = 1,            /* the same, at least 1 */
  N_DAMPED = WITH_RADAU_DAMPED, /* cables that the matrix holds, since they have much damping */
  N_ROWS = N_TENSIONS + N_DAMPED,
  N_UNKNOWNS = N + N_ROWS, /* coordinates, multipliers, then changes of the tensions of these cables */
  RADAU_LAW = 3 + AXES,        /* numbers in the laws of all members */
  RADAU_MASSES = N,            /* entries of the mass matrix */
  RADAU_ENTRIES = AXES,        /* entries below the diagonal of the matrix, and of its factor */
  RADAU_ENTRY_ROOM = AXES,
  RADAU_FACTOR_ROOM = AXES,
  RADAU_ROWS = 1,        /* rows of the factor that hold entries */
  RADAU_COUNTS = 6
};

static const double radau_newton_share = 1e-4; /* of the tolerance, that Newton's method may leave */

/* Row of each unknown (coordinates, then multipliers) in the order of elimination. */
extern const int radau_elimination_row[N_UNKNOWNS];
/* Lower triangle of the matrix, and of its factor, row by row without the diagonal. */
extern const int radau_entry_start[N_UNKNOWNS + 1], radau_entry_column[RADAU_ENTRY_ROOM];
extern const int radau_factor_start[N_UNKNOWNS + 1], radau_factor_column[RADAU_FACTOR_ROOM];
/* Rows of the factor that hold entries. */
extern const int radau_row[RADAU_ROWS];
/* For each entry (r, c) of the factor, those above it in its column: row and index. */
extern const int radau_update_start[RADAU_FACTOR_ROOM + 1], radau_update_row[1], radau_update_entry[1];
/* Where each non-zero of the mass matrix goes: >= 0 an entry, -1 - row the diagonal, others nowhere. */
extern const int radau_mass_entry[RADAU_MASSES];
/* Of each multiplier: its member; of it, then of each damped cable, end by end and axis by axis the coordinate (-1:
 * anchored) and the entry. */
extern const int scene_radau_member[TENSION_ROOM];
extern const int radau_coordinate[2 * AXES * N_ROWS], radau_direction_entry[2 * AXES * N_ROWS];
#if WITH_RADAU_DAMPED
extern const int radau_damped_member[N_DAMPED];
#endif

/* Forces of all but the members above; here none. */
static inline void radau_force(
    const double *coordinate, const double *velocity, const motion_arguments *with, double *force)
{
  int k;
  (void)coordinate;
  (void)velocity;
  (void)with;
  for (k = 0; k < N; ++k) {
    force[k] = 0.0;
  }
}

/* Laws of all members (rest length, EA / l0, damping, offset of its ends) and entries of the mass matrix. */
static inline void radau_laws(const motion_arguments *with, double *law, double *mass)
{
  int k;
  law[0] = 1.0;
  law[1] = (double)with->stiffness[0];
  law[2] = 0.0;
  for (k = 0; k < AXES; ++k) {
    law[3 + k] = 0.0;
  }
  for (k = 0; k < N; ++k) {
    mass[k] = 1.0;
  }
}

#endif
