#ifndef TENSEGRITY_prism_H
#define TENSEGRITY_prism_H

#ifdef TENSEGRITY_PRISM_CONSTANTS
#error "two scenes whose names differ only in upper and lower case cannot be in one source file: rename one"
#endif
#define TENSEGRITY_PRISM_CONSTANTS

#ifdef __cplusplus
extern "C" {
#endif

#ifndef PRISM_API
#if defined(_WIN32)
#define PRISM_API __declspec(dllexport)
#elif defined(__GNUC__)
#define PRISM_API __attribute__((visibility("default")))
#else
#define PRISM_API
#endif
#endif

#define PRISM_C_API_VERSION 3

enum prism_status {
  PRISM_OK = 0,
  PRISM_NON_FINITE_INPUT = 1,
  PRISM_NON_FINITE_RESULT = 2,
  PRISM_INVALID_ARGUMENT = 3,
  PRISM_NULL_POINTER = 4,
  PRISM_STEP_TOO_SMALL = 5,
  PRISM_UNSUPPORTED_MACHINE = 6,
  PRISM_TOO_MANY_EVENTS = 7
};

enum {
  PRISM_ABI_VERSION = 3,
  PRISM_N_NODES = 6,
  PRISM_N_MEMBERS = 12,
  PRISM_N_AXES = 3,
  PRISM_N_COORDINATES = 15,
  PRISM_N_STATES = 30,
  PRISM_N_INPUTS = 0,
  PRISM_N_BAR_PAIRS = 3
};

enum {
  PRISM_NODE_b1 = 0,
  PRISM_NODE_b2 = 1,
  PRISM_NODE_b3 = 2,
  PRISM_NODE_t1 = 3,
  PRISM_NODE_t2 = 4,
  PRISM_NODE_t3 = 5
};

enum {
  PRISM_MEMBER_bar1 = 0,
  PRISM_MEMBER_bar2 = 1,
  PRISM_MEMBER_bar3 = 2,
  PRISM_MEMBER_bottom1 = 3,
  PRISM_MEMBER_bottom2 = 4,
  PRISM_MEMBER_bottom3 = 5,
  PRISM_MEMBER_top1 = 6,
  PRISM_MEMBER_top2 = 7,
  PRISM_MEMBER_top3 = 8,
  PRISM_MEMBER_vertical1 = 9,
  PRISM_MEMBER_vertical2 = 10,
  PRISM_MEMBER_vertical3 = 11
};

enum {
  PRISM_COORDINATE_b1_x = 0,
  PRISM_COORDINATE_b1_y = 1,
  PRISM_COORDINATE_b2_x = 2,
  PRISM_COORDINATE_b2_y = 3,
  PRISM_COORDINATE_b3_x = 4,
  PRISM_COORDINATE_b3_y = 5,
  PRISM_COORDINATE_t1_x = 6,
  PRISM_COORDINATE_t1_y = 7,
  PRISM_COORDINATE_t1_z = 8,
  PRISM_COORDINATE_t2_x = 9,
  PRISM_COORDINATE_t2_y = 10,
  PRISM_COORDINATE_t2_z = 11,
  PRISM_COORDINATE_t3_x = 12,
  PRISM_COORDINATE_t3_y = 13,
  PRISM_COORDINATE_t3_z = 14
};

enum {
  PRISM_BAR_PAIR_bar1_bar2 = 0,
  PRISM_BAR_PAIR_bar1_bar3 = 1,
  PRISM_BAR_PAIR_bar2_bar3 = 2
};

typedef struct {
  int abi_version;
  char name[64];
  char scene_hash[65];
  char formulation[32];
  char emitter[32];
  char precision[8];
  char made_by[160];
} prism_description;

extern PRISM_API const prism_description prism_descriptor;

PRISM_API const char *prism_status_text(int status);

extern PRISM_API const char prism_node_name[6][3];
extern PRISM_API const char prism_member_name[12][10];
extern PRISM_API const char prism_coordinate_name[15][5];
extern PRISM_API const char prism_bar_pair_name[3][10];

PRISM_API int prism_check_machine(void);

PRISM_API const char *prism_missing_instruction_set(int k);

extern PRISM_API const char prism_instruction_sets[];

extern PRISM_API const int prism_coordinate_node[15];
extern PRISM_API const int prism_coordinate_axis[15];

extern PRISM_API const double prism_nominal_coordinate[15];
extern PRISM_API const double prism_nominal_velocity[15];

PRISM_API int prism_compute_member_length(
    const double coordinate[15],
    double member_length[12]);

PRISM_API int prism_compute_member_tension(
    const double coordinate[15],
    double member_tension[12]);

PRISM_API int prism_compute_node_residual(
    const double coordinate[15],
    double node_residual[15]);

PRISM_API int prism_compute_potential_energy(
    const double coordinate[15],
    double potential_energy[1]);

PRISM_API int prism_compute_total_energy(
    const double coordinate[15],
    const double velocity[15],
    double total_energy[1]);

enum { PRISM_TANGENT_STIFFNESS_NNZ = 189 };
extern PRISM_API const int prism_tangent_stiffness_row[189];
extern PRISM_API const int prism_tangent_stiffness_column_start[16];

PRISM_API int prism_compute_tangent_stiffness(
    const double coordinate[15],
    double tangent_stiffness[189]);

PRISM_API int prism_compute_acceleration(
    const double coordinate[15],
    double acceleration[15]);

PRISM_API int prism_compute_bar_distance(
    const double coordinate[15],
    double bar_distance[3]);

PRISM_API int prism_compute_cable_margin(
    const double coordinate[15],
    double cable_margin[9]);

enum {
  PRISM_EVENT_CABLE = 1,
  PRISM_EVENT_CONTACT = 2,
  PRISM_EVENT_CONDITION = 4
};

typedef struct {
  double time;
  int kind;
  int which;
  int direction;
} prism_event;

typedef struct {
  long long n_accepted;
  long long n_rejected;
  long long n_evaluations;
  int watch;
  int stop;
  double (*condition)(double time, const double *coordinate, const double *velocity, void *data);
  void *condition_data;
  prism_event *event;
  long long most_events;
  long long n_events;
  int is_stopped;
  int is_started;
  int may_grow;
  int n_rapid_events;
  int n_close_events;
  int n_trials;
  double progress_time;
  double time_to_event;
  double usual_step;
  double step_limit;
  double step_to_event;
  double time_behind_step;
  double noise_factor;
  double last_event;
  double reached;
} prism_run;

enum { PRISM_RK4_WORK = 456 };
PRISM_API int prism_integrate_rk4(
    double time_start, double step, long long first_step, long long n_steps,
    double state[30],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_done, double work[456]);
PRISM_API int prism_integrate_rk4_run(
    double time_start, double step, long long first_step, long long n_steps,
    double *time, double state[30],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_done, prism_run *run, double work[456]);

#ifdef __cplusplus
}
#endif

#endif
