#ifndef TENSEGRITY_lin_prism_H
#define TENSEGRITY_lin_prism_H

#ifdef TENSEGRITY_LIN_PRISM_CONSTANTS
#error "two scenes whose names differ only in upper and lower case cannot be in one source file: rename one"
#endif
#define TENSEGRITY_LIN_PRISM_CONSTANTS

#ifdef __cplusplus
extern "C" {
#endif

#ifndef LIN_PRISM_API
#if defined(_WIN32)
#define LIN_PRISM_API __declspec(dllexport)
#elif defined(__GNUC__)
#define LIN_PRISM_API __attribute__((visibility("default")))
#else
#define LIN_PRISM_API
#endif
#endif

#define LIN_PRISM_C_API_VERSION 3

enum lin_prism_status {
  LIN_PRISM_OK = 0,
  LIN_PRISM_NON_FINITE_INPUT = 1,
  LIN_PRISM_NON_FINITE_RESULT = 2,

  LIN_PRISM_INVALID_ARGUMENT = 3,
  LIN_PRISM_NULL_POINTER = 4,
  LIN_PRISM_STEP_TOO_SMALL = 5,
  LIN_PRISM_UNSUPPORTED_MACHINE = 6,
  LIN_PRISM_TOO_MANY_EVENTS = 7
};

enum {
  LIN_PRISM_ABI_VERSION = 3,
  LIN_PRISM_N_NODES = 9,
  LIN_PRISM_N_MEMBERS = 6,
  LIN_PRISM_N_AXES = 3,
  LIN_PRISM_N_COORDINATES = 6,
  LIN_PRISM_N_STATES = 12,
  LIN_PRISM_N_INPUTS = 0
};

enum {
  LIN_PRISM_NODE_base_A1 = 0,
  LIN_PRISM_NODE_base_A2 = 1,
  LIN_PRISM_NODE_base_A3 = 2,
  LIN_PRISM_NODE_bar1_A = 3,
  LIN_PRISM_NODE_bar1_B = 4,
  LIN_PRISM_NODE_bar2_A = 5,
  LIN_PRISM_NODE_bar2_B = 6,
  LIN_PRISM_NODE_bar3_A = 7,
  LIN_PRISM_NODE_bar3_B = 8
};

enum {
  LIN_PRISM_MEMBER_side1 = 0,
  LIN_PRISM_MEMBER_side2 = 1,
  LIN_PRISM_MEMBER_side3 = 2,
  LIN_PRISM_MEMBER_top1 = 3,
  LIN_PRISM_MEMBER_top2 = 4,
  LIN_PRISM_MEMBER_top3 = 5
};

enum {
  LIN_PRISM_COORDINATE_bar1_elevation = 0,
  LIN_PRISM_COORDINATE_bar1_azimuth = 1,
  LIN_PRISM_COORDINATE_bar2_elevation = 2,
  LIN_PRISM_COORDINATE_bar2_azimuth = 3,
  LIN_PRISM_COORDINATE_bar3_elevation = 4,
  LIN_PRISM_COORDINATE_bar3_azimuth = 5
};

typedef struct {
  int abi_version;
  char name[64];
  char scene_hash[65];
  char formulation[32];
  char emitter[32];
  char precision[8];
  char made_by[160];
} lin_prism_description;

extern LIN_PRISM_API const lin_prism_description lin_prism_descriptor;

LIN_PRISM_API const char *lin_prism_status_text(int status);

extern LIN_PRISM_API const char lin_prism_node_name[9][8];
extern LIN_PRISM_API const char lin_prism_member_name[6][6];
extern LIN_PRISM_API const char lin_prism_coordinate_name[6][15];

LIN_PRISM_API int lin_prism_check_machine(void);

LIN_PRISM_API const char *lin_prism_missing_instruction_set(int k);

extern LIN_PRISM_API const char lin_prism_instruction_sets[];

extern LIN_PRISM_API const double lin_prism_nominal_coordinate[6];
extern LIN_PRISM_API const double lin_prism_nominal_velocity[6];
extern LIN_PRISM_API const double lin_prism_nominal_node_load[27];

LIN_PRISM_API int lin_prism_compute_potential_energy(
    const double coordinate[6],
    const double node_load[27],
    double potential_energy[1]);

LIN_PRISM_API int lin_prism_compute_coordinate_force(
    const double coordinate[6],
    const double node_load[27],
    double coordinate_force[6]);

enum { LIN_PRISM_TANGENT_STIFFNESS_NNZ = 36 };
extern LIN_PRISM_API const int lin_prism_tangent_stiffness_row[36];
extern LIN_PRISM_API const int lin_prism_tangent_stiffness_column_start[7];

LIN_PRISM_API int lin_prism_compute_tangent_stiffness(
    const double coordinate[6],
    const double node_load[27],
    double tangent_stiffness[36]);

LIN_PRISM_API int lin_prism_compute_acceleration(
    const double coordinate[6],
    const double velocity[6],
    const double node_load[27],
    double acceleration[6]);

LIN_PRISM_API int lin_prism_compute_total_energy(
    const double coordinate[6],
    const double velocity[6],
    const double node_load[27],
    double total_energy[1]);

typedef struct {
  long long n_accepted;
  long long n_rejected;
  long long n_evaluations;
  int is_started;
  int may_grow;
  double reached;
} lin_prism_run;

enum { LIN_PRISM_RK853_WORK = 342 };
LIN_PRISM_API int lin_prism_integrate_rk853(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[12],
    const double node_load[27],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_accepted, long long *n_rejected, double work[342]);
LIN_PRISM_API int lin_prism_integrate_rk853_run(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[12],
    const double node_load[27],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    lin_prism_run *run, double work[342]);

enum {
  LIN_PRISM_NOT_CONVERGED = 8,
  LIN_PRISM_UNSTABLE = 9,
  LIN_PRISM_BRANCH_LOST = 10
};

typedef struct {
  int status;
  int iterations;
  int shifted;
  double contraction;
  double residual;
  double smallest_pivot;
  double potential_energy;
} lin_prism_equilibrium_report;

enum { LIN_PRISM_EQUILIBRIUM_WORK = 138 };
LIN_PRISM_API int lin_prism_find_equilibrium(
    double coordinate[6],
    const double node_load[27],
    double tolerance, int most_iterations, lin_prism_equilibrium_report *report,
    double work[138]);

LIN_PRISM_API int lin_prism_find_equilibrium_path(
    const double start[6], long long n_path,
    const double *node_load,
    double tolerance, int most_iterations, double *coordinate, lin_prism_equilibrium_report *report,
    long long *n_found, double work[138]);

#ifdef __cplusplus
}
#endif

#endif
