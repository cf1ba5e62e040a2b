/* Equilibria and a motion of the mast, by the C functions of its library.
 *
 * Usage: mast [MOTOR]     MOTOR [m] is added to the rest length of the cable with the motor; default 0.03
 *
 * Each line of the output has a quantity, the name of a member or coordinate, a value and its unit.
 * The exit code is 0, 1 where the library reports an error, 2 for a wrong argument.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mast.h"

enum { N_SAMPLES = 4, MOST_EVENTS = 100 };

/* Print why a function of the library failed; return its status. */
static int report(const char *function, int status)
{
  if (status != MAST_OK) {
    fprintf(stderr, "error: %s: %s (status %d)\n", function, mast_status_text(status), status);
  }
  return status;
}

/* Find the equilibrium with this value of the motor, beginning at `coordinate`. */
static int find_equilibrium(double motor, double coordinate[MAST_N_COORDINATES])
{
  const double tolerance = 1e-9; /* [N], largest force that remains at a free coordinate */
  const int most_iterations = 50;
  double input[MAST_N_INPUTS] = {0}, work[MAST_EQUILIBRIUM_WORK];
  mast_equilibrium_report how;

  input[MAST_INPUT_motor] = motor;
  return report("mast_find_equilibrium",
                mast_find_equilibrium(coordinate, input, tolerance, most_iterations, &how, work));
}

static int print_tensions(const char *quantity, double motor, const double coordinate[MAST_N_COORDINATES])
{
  double input[MAST_N_INPUTS] = {0}, tension[MAST_N_MEMBERS];
  int k, status;

  input[MAST_INPUT_motor] = motor;
  status = report("mast_compute_member_tension", mast_compute_member_tension(coordinate, input, tension));
  for (k = 0; status == MAST_OK && k < MAST_N_MEMBERS; ++k) {
    printf("%s %s %.12g N\n", quantity, mast_member_name[k], tension[k]);
  }
  return status;
}

static void print_coordinates(const char *quantity, const double coordinate[MAST_N_COORDINATES])
{
  int k;

  for (k = 0; k < MAST_N_COORDINATES; ++k) {
    printf("%s %s %.12g m\n", quantity, mast_coordinate_name[k], coordinate[k]);
  }
}

/* Print the total energy of a state: it stays constant, because the mast has no damping. */
static int print_energy(const char *when, double motor, const double state[MAST_N_STATES])
{
  double input[MAST_N_INPUTS] = {0}, energy;
  int status;

  input[MAST_INPUT_motor] = motor;
  status = report("mast_compute_total_energy",
                  mast_compute_total_energy(state, state + MAST_N_COORDINATES, input, &energy));
  if (status == MAST_OK) {
    printf("energy %s %.12g J\n", when, energy);
  }
  return status;
}

/* Integrate from rest at `coordinate`; the motor has its value from the first moment on. */
static int print_motion(double motor, const double coordinate[MAST_N_COORDINATES])
{
  static const double sample_time[N_SAMPLES] = {0.05, 0.1, 0.15, 0.2};
  const double rtol = 1e-9, atol = 1e-12; /* of each step; atol in m and m/s */
  const long long most_steps = 100000;
  double sample[N_SAMPLES][MAST_N_STATES], state[MAST_N_STATES] = {0};
  double input[MAST_N_INPUTS] = {0}, work[MAST_RK853_WORK], time = 0.0, step = 0.0; /* step 0: choose one */
  long long n_sampled = 0, k;
  mast_event event[MOST_EVENTS];
  mast_run run;
  char label[32];
  int status;

  memcpy(state, coordinate, MAST_N_COORDINATES * sizeof state[0]);
  memset(&run, 0, sizeof run); /* required: fields that a later version adds are then zero too */
  run.watch = MAST_EVENT_CABLE; /* steps end where a cable goes slack or taut */
  run.event = event;
  run.most_events = MOST_EVENTS;
  input[MAST_INPUT_motor] = motor;
  status = print_energy("start", motor, state);
  if (status != MAST_OK) {
    return status;
  }
  status = report("mast_integrate_rk853_run",
                  mast_integrate_rk853_run(sample_time[N_SAMPLES - 1], rtol, atol, most_steps, &time, &step, state,
                                           input, N_SAMPLES, sample_time, &sample[0][0], &n_sampled, &run, work));
  if (status != MAST_OK) {
    return status;
  }
  if (n_sampled < N_SAMPLES) {
    fprintf(stderr, "error: the motion ended at %g s, after %lld steps\n", time, most_steps);
    return MAST_STEP_TOO_SMALL;
  }
  for (k = 0; k < N_SAMPLES; ++k) {
    snprintf(label, sizeof label, "motion_%.2fs", sample_time[k]);
    print_coordinates(label, sample[k]);
  }
  for (k = 0; k < run.n_events && k < run.most_events; ++k) {
    printf("%s %s %.12g s\n", event[k].direction > 0 ? "taut" : "slack", mast_member_name[event[k].which],
           event[k].time);
  }
  return print_energy("end", motor, state);
}

int main(int argc, char **argv)
{
  double motor = 0.03, rest[MAST_N_COORDINATES], moved[MAST_N_COORDINATES];
  char *end = NULL;

  if (argc > 2 || (argc == 2 && (motor = strtod(argv[1], &end), end == argv[1] || *end != '\0'))) {
    fprintf(stderr, "usage: %s [MOTOR]: MOTOR is a length in metres, such as 0.03\n", argv[0]);
    return 2;
  }
  if (mast_descriptor.abi_version != MAST_ABI_VERSION) {
    fprintf(stderr, "error: the library has version %d of the interface, its header %d\n",
            mast_descriptor.abi_version, MAST_ABI_VERSION);
    return 1;
  }
  memcpy(rest, mast_nominal_coordinate, sizeof rest);
  if (find_equilibrium(0.0, rest) != MAST_OK || print_tensions("tension_at_rest", 0.0, rest) != MAST_OK) {
    return 1;
  }
  memcpy(moved, rest, sizeof moved);
  if (find_equilibrium(motor, moved) != MAST_OK || print_tensions("tension_moved", motor, moved) != MAST_OK) {
    return 1;
  }
  print_coordinates("position_moved", moved);
  return print_motion(motor, rest) == MAST_OK ? 0 : 1;
}
