/* Sample of what the generator writes for a simulated loop: the plant and its arguments. It is the structure of
 * config.h. */
#ifndef CONTROL_CLOSED_LOOP_CONFIG_H
#define CONTROL_CLOSED_LOOP_CONFIG_H
#include "step.h"

#define WITH_LOADS 1 /* loads of the plant can change */

enum { PLANT_OK = 0, PLANT_STEP_TOO_SMALL = 5 }; /* statuses of the plant */
enum { N_PLANT = N_X, N_TENSIONS = 1, LOAD_SIZE = 1 };

/* Functions of the plant. */
typedef struct {
  int (*integrate)(double span, double *time, real state[2], const real input[1], const real node_load[1]);
} plant_functions;

/* Arguments of the plant besides its state. */
typedef struct {
  real *input, *node_load;
} plant_arguments;

static inline int plant_integrate(
    const plant_functions *f, double span, double *time, real *state, const plant_arguments *with, real *work)
{
  (void)work;
  return f->integrate(span, time, state, with->input, with->node_load);
}

static inline int plant_tension(
    const plant_functions *f, const real *state, const plant_arguments *with, real *tension)
{
  (void)f;
  tension[0] = (real)100.0 * (state[0] - with->input[0]);
  return PLANT_OK;
}

#if WITH_ESTIMATOR
/* Measurements without noise; memory: of the size of a measured quantity. */
static inline int plant_measure(
    const plant_functions *f, const real *state, const plant_arguments *with, real *memory, real *measured)
{
  (void)f;
  (void)with;
  memory[0] = (real)1.0 + state[0];
  measured[0] = memory[0];
  return PLANT_OK;
}

static inline int scene_control_next(scene_control *c, const real *length, real *rest_length)
{
  return control_step_next(c, length, NULL, rest_length);
}
#else
static inline int scene_control_next_state(scene_control *c, const real *state, real *rest_length)
{
  return control_step_next(c, NULL, state, rest_length);
}
#endif

static inline int scene_control_init(scene_control *c, const real *coordinate)
{
  return control_init(c, coordinate);
}

#endif
