/* One instance of a functional mock-up unit, common to FMI 2.0 and 3.0; fmu_config.h describes the structure. */
#ifndef FMU_H
#define FMU_H
#include "fmu_config.h"

#include <stddef.h>

#if defined(_WIN32)
#define FMU_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMU_EXPORT __attribute__((visibility("default")))
#else
#define FMU_EXPORT
#endif

/* What functions return, by the numbers that both versions of the standard have for it. */
enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR, FMU_FATAL };

/* Modes of an instance. */
enum {
  FMU_INSTANTIATED = 1,
  FMU_INITIALIZATION = 2,
  FMU_EVENT = 4,      /* model exchange: discrete values may change */
  FMU_CONTINUOUS = 8, /* model exchange: the importer integrates */
  FMU_STEP = 16,      /* co-simulation: between steps */
  FMU_TERMINATED = 32,
  FMU_FAILED = 64
};

/* Value references: time, arguments (inputs, then parameters), states, their derivatives, calculated values (outputs,
 * then margins), then a Boolean for each margin (whether it is negative) and the number of events. */
enum {
  FMU_TIME = 0,
  FMU_ARGUMENT = 1,
  FMU_STATE = FMU_ARGUMENT + FMU_N_ARGUMENTS,
  FMU_RATE = FMU_STATE + FMU_N_STATES,
  FMU_VALUE = FMU_RATE + FMU_N_STATES,
  FMU_SLACK = FMU_VALUE + FMU_N_VALUES,
  FMU_EVENT_COUNT = FMU_SLACK + FMU_N_MARGINS,
  FMU_N_REFERENCES
};

enum { FMU_MOST_EVENTS = 64 }; /* that are kept until their time has come */

/* The integration of a co-simulation. Where nothing has been set since the last step and steps of the integrator are
 * longer than those of the communication, it is ahead of the communication point, with states at the points that are
 * expected next, by its dense output. */
typedef struct {
  fmu_integration integration;
  double time; /* of `state`, at or behind the communication point */
  double state[FMU_N_STATES];
  long long n_samples; /* points that are expected; the first n_sampled are filled, n_used are behind */
  long long n_sampled;
  long long n_used;
  double sample_time[FMU_AHEAD];
  double sample[FMU_AHEAD * FMU_N_STATES];
  int n_events; /* that are ahead */
  fmu_event event[FMU_MOST_EVENTS];
} fmu_front;

/* What changes while an instance runs: what is stored and restored as the state of the unit. */
typedef struct {
  char token[40]; /* of the model description: bytes of other units are refused */
  int mode;
  int is_exchange; /* model exchange: 1, co-simulation: 0 */
  int n_events;    /* margins that changed their sign */
  int is_stale;    /* the integration has to begin anew: a value has been set */
  double time;
  double rtol;
  double argument[FMU_N_ARGUMENTS + 1];
  double state[FMU_N_STATES];
  int is_slack[FMU_N_MARGINS + 1];
  fmu_front front;
} fmu_memory;

typedef struct fmu_instance fmu_instance;

struct fmu_instance {
  fmu_memory now;
  unsigned char is_known[FMU_N_BLOCKS + 1]; /* blocks of values that belong to the present state */
  double value[FMU_N_VALUES + 1];
  double rate[FMU_N_STATES];
  int is_rate_known;
  int is_logging;
  void (*report)(fmu_instance *instance, int status, const char *category, const char *text);
  void (*release)(void *memory);
  void *(*allocate)(size_t count, size_t size);
  void *environment;
  void *logger;
  char name[128];
};

static void fmu_report(fmu_instance *instance, int status, const char *category, const char *format, ...);
static int fmu_check_mode(fmu_instance *instance, int allowed, const char *function);
static void fmu_reset(fmu_instance *instance);
static void fmu_forget(fmu_instance *instance);
static int fmu_get_number(fmu_instance *instance, size_t reference, double *value);
static int fmu_set_number(fmu_instance *instance, size_t reference, double value);
static int fmu_get_flag(fmu_instance *instance, size_t reference, int *value);
static int fmu_get_count(fmu_instance *instance, size_t reference, int *value);
static int fmu_get_rates(fmu_instance *instance, double *rate);
static int fmu_get_indicators(fmu_instance *instance, double *indicator);
static int fmu_set_states(fmu_instance *instance, const double *state);
static int fmu_update_slack(fmu_instance *instance, int counts);
static int fmu_leave_initialization(fmu_instance *instance);
static int fmu_check_step(fmu_instance *instance, double point, double size);
static int fmu_do_step(fmu_instance *instance, double point, double size);
static int fmu_find_derivative(
    fmu_instance *instance, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
    const double *seed, double *sensitivity);
static int fmu_store(fmu_instance *instance, void **stored);
static int fmu_restore(fmu_instance *instance, const void *stored);
static int fmu_check_stored(fmu_instance *instance, const void *stored, size_t size);

#endif
