/* The functions of the mast for Octave and MATLAB.
 *
 *   q = mast_mex('equilibrium', start, motor)             coordinates [m]; start: a column, [] for those of the scene
 *   t = mast_mex('member_tension', q, motor)              [N]
 *   e = mast_mex('total_energy', q, v, motor)             [J]
 *   [x, events] = mast_mex('motion', q, motor, times)     from rest; states, a column for each time [m; m/s], and
 *                                                         rows of time [s], member, 1 taut or -1 slack
 *   names = mast_mex('member_names')                      cell arrays
 *   names = mast_mex('coordinate_names')
 *
 * An error of the library is raised with the identifier mast:status and its text.
 */
#include <string.h>

#include "mast.h"
#include "mex.h"

enum { MOST_EVENTS = 100 };

static void check(const char *function, int status)
{
  if (status != MAST_OK) {
    mexErrMsgIdAndTxt("mast:status", "%s: %s (status %d)", function, mast_status_text(status), status);
  }
}

/* Return a column of real numbers, of `count` numbers where that is not 0. */
static const double *column(const mxArray *array, size_t count, const char *name)
{
  if (!mxIsDouble(array) || mxIsComplex(array) || mxIsSparse(array) ||
      (count > 0 && mxGetNumberOfElements(array) != count)) {
    mexErrMsgIdAndTxt("mast:argument", "%s must have %d real numbers", name, (int)count);
  }
  return mxGetPr(array);
}

static void read_motor(const mxArray *array, double input[MAST_N_INPUTS])
{
  memset(input, 0, MAST_N_INPUTS * sizeof input[0]);
  input[MAST_INPUT_motor] = *column(array, 1, "motor");
}

static mxArray *list(int count, const char *text, size_t length)
{
  mxArray *names = mxCreateCellMatrix((mwSize)count, 1);
  int k;

  for (k = 0; k < count; ++k) {
    mxSetCell(names, (mwIndex)k, mxCreateString(text + (size_t)k * length));
  }
  return names;
}

static mxArray *equilibrium(const mxArray *start, const mxArray *motor)
{
  const double tolerance = 1e-9; /* [N], largest force that remains at a free coordinate */
  const int most_iterations = 50;
  mxArray *result = mxCreateDoubleMatrix(MAST_N_COORDINATES, 1, mxREAL);
  double input[MAST_N_INPUTS], work[MAST_EQUILIBRIUM_WORK];
  mast_equilibrium_report report;
  const double *from =
      mxIsEmpty(start) ? mast_nominal_coordinate : column(start, MAST_N_COORDINATES, "start");

  read_motor(motor, input);
  memcpy(mxGetPr(result), from, MAST_N_COORDINATES * sizeof *from);
  check("mast_find_equilibrium",
        mast_find_equilibrium(mxGetPr(result), input, tolerance, most_iterations, &report, work));
  return result;
}

static mxArray *member_tension(const mxArray *coordinate, const mxArray *motor)
{
  mxArray *result = mxCreateDoubleMatrix(MAST_N_MEMBERS, 1, mxREAL);
  double input[MAST_N_INPUTS];

  read_motor(motor, input);
  check("mast_compute_member_tension",
        mast_compute_member_tension(column(coordinate, MAST_N_COORDINATES, "coordinate"), input, mxGetPr(result)));
  return result;
}

static mxArray *total_energy(const mxArray *coordinate, const mxArray *velocity, const mxArray *motor)
{
  double input[MAST_N_INPUTS], energy;

  read_motor(motor, input);
  check("mast_compute_total_energy",
        mast_compute_total_energy(column(coordinate, MAST_N_COORDINATES, "coordinate"),
                                  column(velocity, MAST_N_COORDINATES, "velocity"), input, &energy));
  return mxCreateDoubleScalar(energy);
}

static mxArray *event_rows(const mast_run *run)
{
  const long long count = run->n_events < run->most_events ? run->n_events : run->most_events;
  mxArray *rows = mxCreateDoubleMatrix((mwSize)count, 3, mxREAL);
  double *value = mxGetPr(rows);
  long long k;

  for (k = 0; k < count; ++k) {
    value[k] = run->event[k].time;
    value[k + count] = run->event[k].which + 1; /* indices begin at 1 here */
    value[k + 2 * count] = run->event[k].direction;
  }
  return rows;
}

/* Integrate from rest at time 0 to the last sample time; the motor has its value from the first moment on. */
static void motion(int n_results, mxArray *result[], const mxArray *coordinate, const mxArray *motor,
                   const mxArray *times)
{
  const double rtol = 1e-9, atol = 1e-12; /* of each step; atol in m and m/s */
  const long long most_steps = 100000, n_samples = (long long)mxGetNumberOfElements(times);
  const double *sample_time = column(times, 0, "times");
  double state[MAST_N_STATES] = {0}, input[MAST_N_INPUTS], work[MAST_RK853_WORK], time = 0.0, step = 0.0;
  long long n_sampled = 0;
  mast_event event[MOST_EVENTS];
  mast_run run;

  if (n_samples == 0) {
    mexErrMsgIdAndTxt("mast:argument", "times must have at least one time");
  }
  memcpy(state, column(coordinate, MAST_N_COORDINATES, "coordinate"), MAST_N_COORDINATES * sizeof state[0]);
  read_motor(motor, input);
  memset(&run, 0, sizeof run);  /* required: fields that a later version adds are then zero too */
  run.watch = MAST_EVENT_CABLE; /* steps end where a cable goes slack or taut */
  run.event = event;
  run.most_events = MOST_EVENTS;
  result[0] = mxCreateDoubleMatrix(MAST_N_STATES, (mwSize)n_samples, mxREAL);
  check("mast_integrate_rk853_run",
        mast_integrate_rk853_run(sample_time[n_samples - 1], rtol, atol, most_steps, &time, &step, state, input,
                                 n_samples, sample_time, mxGetPr(result[0]), &n_sampled, &run, work));
  if (n_sampled < n_samples) {
    mexErrMsgIdAndTxt("mast:steps", "the motion ended at %g s, after %d steps", time, (int)most_steps);
  }
  if (n_results > 1) {
    result[1] = event_rows(&run);
  }
}

void mexFunction(int n_results, mxArray *result[], int n_arguments, const mxArray *argument[])
{
  char what[32] = "";
  const int n = n_arguments - 1;

  if (n_arguments < 1 || mxGetString(argument[0], what, sizeof what) != 0) {
    mexErrMsgIdAndTxt("mast:argument", "the first argument is the name of a function; see mast_mex.c");
  }
  if (mast_descriptor.abi_version != MAST_ABI_VERSION) {
    mexErrMsgIdAndTxt("mast:version", "the library and its header have different versions of the interface");
  }
  if (strcmp(what, "equilibrium") == 0 && n == 2) {
    result[0] = equilibrium(argument[1], argument[2]);
  } else if (strcmp(what, "member_tension") == 0 && n == 2) {
    result[0] = member_tension(argument[1], argument[2]);
  } else if (strcmp(what, "total_energy") == 0 && n == 3) {
    result[0] = total_energy(argument[1], argument[2], argument[3]);
  } else if (strcmp(what, "motion") == 0 && n == 3) {
    motion(n_results, result, argument[1], argument[2], argument[3]);
  } else if (strcmp(what, "member_names") == 0 && n == 0) {
    result[0] = list(MAST_N_MEMBERS, mast_member_name[0], sizeof mast_member_name[0]);
  } else if (strcmp(what, "coordinate_names") == 0 && n == 0) {
    result[0] = list(MAST_N_COORDINATES, mast_coordinate_name[0], sizeof mast_coordinate_name[0]);
  } else {
    mexErrMsgIdAndTxt("mast:argument", "no function '%s' with %d arguments; see mast_mex.c", what, n);
  }
}
