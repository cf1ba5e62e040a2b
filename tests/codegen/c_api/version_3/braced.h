#ifndef TENSEGRITY_braced_H
#define TENSEGRITY_braced_H

#ifdef TENSEGRITY_BRACED_CONSTANTS
#error "two scenes whose names differ only in upper and lower case cannot be in one source file: rename one"
#endif
#define TENSEGRITY_BRACED_CONSTANTS

#ifdef __cplusplus
extern "C" {
#endif

#ifndef BRACED_API
#if defined(_WIN32)
#define BRACED_API __declspec(dllexport)
#elif defined(__GNUC__)
#define BRACED_API __attribute__((visibility("default")))
#else
#define BRACED_API
#endif
#endif

#define BRACED_C_API_VERSION 3

enum braced_status {
  BRACED_OK = 0,
  BRACED_NON_FINITE_INPUT = 1,
  BRACED_NON_FINITE_RESULT = 2,
  BRACED_INVALID_ARGUMENT = 3,
  BRACED_NULL_POINTER = 4,
  BRACED_STEP_TOO_SMALL = 5,
  BRACED_UNSUPPORTED_MACHINE = 6,
  BRACED_TOO_MANY_EVENTS = 7
};

enum {
  BRACED_ABI_VERSION = 3,
  BRACED_N_NODES = 4,
  BRACED_N_MEMBERS = 6,
  BRACED_N_AXES = 3,
  BRACED_N_COORDINATES = 8,
  BRACED_N_STATES = 16,
  BRACED_N_INPUTS = 2
};

enum {
  BRACED_NODE_n0 = 0,
  BRACED_NODE_n1 = 1,
  BRACED_NODE_n2 = 2,
  BRACED_NODE_n3 = 3
};

enum {
  BRACED_MEMBER_e0 = 0,
  BRACED_MEMBER_e1 = 1,
  BRACED_MEMBER_e2 = 2,
  BRACED_MEMBER_e3 = 3,
  BRACED_MEMBER_e4 = 4,
  BRACED_MEMBER_e5 = 5
};

enum {
  BRACED_COORDINATE_n1_x = 0,
  BRACED_COORDINATE_n1_y = 1,
  BRACED_COORDINATE_n2_x = 2,
  BRACED_COORDINATE_n2_y = 3,
  BRACED_COORDINATE_n2_z = 4,
  BRACED_COORDINATE_n3_x = 5,
  BRACED_COORDINATE_n3_y = 6,
  BRACED_COORDINATE_n3_z = 7
};

enum {
  BRACED_INPUT_wind = 0,
  BRACED_INPUT_thrust = 1
};

typedef struct {
  int abi_version;
  char name[64];
  char scene_hash[65];
  char formulation[32];
  char emitter[32];
  char precision[8];
  char made_by[160];
} braced_description;

extern BRACED_API const braced_description braced_descriptor;

BRACED_API const char *braced_status_text(int status);

extern BRACED_API const char braced_node_name[4][3];
extern BRACED_API const char braced_member_name[6][3];
extern BRACED_API const char braced_coordinate_name[8][5];
extern BRACED_API const char braced_input_name[2][7];

BRACED_API int braced_check_machine(void);

BRACED_API const char *braced_missing_instruction_set(int k);

extern BRACED_API const char braced_instruction_sets[];

extern BRACED_API const int braced_coordinate_node[8];
extern BRACED_API const int braced_coordinate_axis[8];

extern BRACED_API const double braced_nominal_coordinate[8];
extern BRACED_API const double braced_nominal_velocity[8];
extern BRACED_API const double braced_nominal_input[2];
extern BRACED_API const double braced_nominal_rest_length[6];
extern BRACED_API const double braced_nominal_spring_constant[4];
extern BRACED_API const double braced_nominal_axial_stiffness[2];
extern BRACED_API const double braced_nominal_damping[6];
extern BRACED_API const double braced_nominal_node_mass[3];
extern BRACED_API const double braced_nominal_node_load[12];
extern BRACED_API const double braced_nominal_anchor_position[6];
extern BRACED_API const double braced_nominal_gravity[3];

BRACED_API int braced_compute_member_vector(
    const double coordinate[8],
    const double anchor_position[6],
    double member_vector[18]);

BRACED_API int braced_compute_member_vector_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *anchor_position, int anchor_position_stride,
    double *member_vector, int *status);

BRACED_API int braced_compute_member_length(
    const double coordinate[8],
    const double anchor_position[6],
    double member_length[6]);

BRACED_API int braced_compute_member_length_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *anchor_position, int anchor_position_stride,
    double *member_length, int *status);

BRACED_API int braced_compute_member_tension(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double member_tension[6]);

BRACED_API int braced_compute_member_tension_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *member_tension, int *status);

BRACED_API int braced_compute_force_density(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double force_density[6]);

BRACED_API int braced_compute_force_density_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *force_density, int *status);

BRACED_API int braced_compute_member_extension(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double anchor_position[6],
    double member_extension[6]);

BRACED_API int braced_compute_member_extension_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *anchor_position, int anchor_position_stride,
    double *member_extension, int *status);

BRACED_API int braced_compute_tension_rest_length_derivative(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double tension_rest_length_derivative[6]);

BRACED_API int braced_compute_tension_rest_length_derivative_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *tension_rest_length_derivative, int *status);

BRACED_API int braced_compute_node_speed(
    const double velocity[8],
    double node_speed[4]);

BRACED_API int braced_compute_node_speed_batch(
    int n_batch,
    const double *velocity, int velocity_stride,
    double *node_speed, int *status);

BRACED_API int braced_compute_node_force(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double node_force[12]);

BRACED_API int braced_compute_node_force_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *node_force, int *status);

BRACED_API int braced_compute_node_residual(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double node_residual[8]);

BRACED_API int braced_compute_node_residual_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *node_residual, int *status);

BRACED_API int braced_compute_support_reaction(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double support_reaction[4]);

BRACED_API int braced_compute_support_reaction_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *support_reaction, int *status);

BRACED_API int braced_compute_cable_force(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double cable_force[8]);

BRACED_API int braced_compute_cable_force_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *cable_force, int *status);

BRACED_API int braced_compute_member_law(
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double member_law[36]);

BRACED_API int braced_compute_member_law_batch(
    int n_batch,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *member_law, int *status);

BRACED_API int braced_compute_elastic_energy(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double anchor_position[6],
    double elastic_energy[1]);

BRACED_API int braced_compute_elastic_energy_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *anchor_position, int anchor_position_stride,
    double *elastic_energy, int *status);

BRACED_API int braced_compute_potential_energy(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double potential_energy[1]);

BRACED_API int braced_compute_potential_energy_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *potential_energy, int *status);

BRACED_API int braced_compute_kinetic_energy(
    const double velocity[8],
    const double node_mass[3],
    double kinetic_energy[1]);

BRACED_API int braced_compute_kinetic_energy_batch(
    int n_batch,
    const double *velocity, int velocity_stride,
    const double *node_mass, int node_mass_stride,
    double *kinetic_energy, int *status);

BRACED_API int braced_compute_total_energy(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double total_energy[1]);

BRACED_API int braced_compute_total_energy_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *total_energy, int *status);

BRACED_API int braced_compute_acceleration(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double acceleration[8]);

BRACED_API int braced_compute_acceleration_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *acceleration, int *status);

BRACED_API int braced_compute_state_derivative(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double state_derivative[16]);

BRACED_API int braced_compute_state_derivative_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *state_derivative, int *status);

enum { BRACED_MASS_MATRIX_NNZ = 14 };
extern BRACED_API const int braced_mass_matrix_row[14];
extern BRACED_API const int braced_mass_matrix_column_start[9];

BRACED_API int braced_compute_mass_matrix(
    const double node_mass[3],
    double mass_matrix[14]);

BRACED_API int braced_compute_mass_matrix_batch(
    int n_batch,
    const double *node_mass, int node_mass_stride,
    double *mass_matrix, int *status);

enum { BRACED_MATERIAL_STIFFNESS_NNZ = 64 };
extern BRACED_API const int braced_material_stiffness_row[64];
extern BRACED_API const int braced_material_stiffness_column_start[9];

BRACED_API int braced_compute_material_stiffness(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double anchor_position[6],
    double material_stiffness[64]);

BRACED_API int braced_compute_material_stiffness_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *anchor_position, int anchor_position_stride,
    double *material_stiffness, int *status);

enum { BRACED_GEOMETRIC_STIFFNESS_NNZ = 64 };
extern BRACED_API const int braced_geometric_stiffness_row[64];
extern BRACED_API const int braced_geometric_stiffness_column_start[9];

BRACED_API int braced_compute_geometric_stiffness(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double anchor_position[6],
    double geometric_stiffness[64]);

BRACED_API int braced_compute_geometric_stiffness_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *anchor_position, int anchor_position_stride,
    double *geometric_stiffness, int *status);

enum { BRACED_TANGENT_STIFFNESS_NNZ = 64 };
extern BRACED_API const int braced_tangent_stiffness_row[64];
extern BRACED_API const int braced_tangent_stiffness_column_start[9];

BRACED_API int braced_compute_tangent_stiffness(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double anchor_position[6],
    double tangent_stiffness[64]);

BRACED_API int braced_compute_tangent_stiffness_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *anchor_position, int anchor_position_stride,
    double *tangent_stiffness, int *status);

enum { BRACED_DAMPING_MATRIX_NNZ = 64 };
extern BRACED_API const int braced_damping_matrix_row[64];
extern BRACED_API const int braced_damping_matrix_column_start[9];

BRACED_API int braced_compute_damping_matrix(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double damping_matrix[64]);

BRACED_API int braced_compute_damping_matrix_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *damping_matrix, int *status);

enum { BRACED_EQUILIBRIUM_MATRIX_NNZ = 24 };
extern BRACED_API const int braced_equilibrium_matrix_row[24];
extern BRACED_API const int braced_equilibrium_matrix_column_start[7];

BRACED_API int braced_compute_equilibrium_matrix(
    const double coordinate[8],
    const double anchor_position[6],
    double equilibrium_matrix[24]);

BRACED_API int braced_compute_equilibrium_matrix_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *anchor_position, int anchor_position_stride,
    double *equilibrium_matrix, int *status);

enum { BRACED_STATE_JACOBIAN_NNZ = 136 };
extern BRACED_API const int braced_state_jacobian_row[136];
extern BRACED_API const int braced_state_jacobian_column_start[17];

BRACED_API int braced_compute_state_jacobian(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double anchor_position[6],
    double state_jacobian[136]);

BRACED_API int braced_compute_state_jacobian_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *anchor_position, int anchor_position_stride,
    double *state_jacobian, int *status);

enum { BRACED_INPUT_JACOBIAN_NNZ = 12 };
extern BRACED_API const int braced_input_jacobian_row[12];
extern BRACED_API const int braced_input_jacobian_column_start[3];

BRACED_API int braced_compute_input_jacobian(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double anchor_position[6],
    double input_jacobian[12]);

BRACED_API int braced_compute_input_jacobian_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *anchor_position, int anchor_position_stride,
    double *input_jacobian, int *status);

enum { BRACED_REST_LENGTH_JACOBIAN_NNZ = 36 };
extern BRACED_API const int braced_rest_length_jacobian_row[36];
extern BRACED_API const int braced_rest_length_jacobian_column_start[7];

BRACED_API int braced_compute_rest_length_jacobian(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double anchor_position[6],
    double rest_length_jacobian[36]);

BRACED_API int braced_compute_rest_length_jacobian_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *anchor_position, int anchor_position_stride,
    double *rest_length_jacobian, int *status);

enum { BRACED_RESIDUAL_REST_LENGTH_JACOBIAN_NNZ = 24 };
extern BRACED_API const int braced_residual_rest_length_jacobian_row[24];
extern BRACED_API const int braced_residual_rest_length_jacobian_column_start[7];

BRACED_API int braced_compute_residual_rest_length_jacobian(
    const double coordinate[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double anchor_position[6],
    double residual_rest_length_jacobian[24]);

BRACED_API int braced_compute_residual_rest_length_jacobian_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *anchor_position, int anchor_position_stride,
    double *residual_rest_length_jacobian, int *status);

enum { BRACED_TENSION_JACOBIAN_NNZ = 24 };
extern BRACED_API const int braced_tension_jacobian_row[24];
extern BRACED_API const int braced_tension_jacobian_column_start[9];

BRACED_API int braced_compute_tension_jacobian(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double tension_jacobian[24]);

BRACED_API int braced_compute_tension_jacobian_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *tension_jacobian, int *status);

enum { BRACED_PARAMETER_JACOBIAN_NNZ = 176 };
extern BRACED_API const int braced_parameter_jacobian_row[176];
extern BRACED_API const int braced_parameter_jacobian_column_start[43];

BRACED_API int braced_compute_parameter_jacobian(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    double parameter_jacobian[176]);

BRACED_API int braced_compute_parameter_jacobian_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    double *parameter_jacobian, int *status);

BRACED_API int braced_compute_cable_margin(
    const double coordinate[8],
    const double velocity[8],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double anchor_position[6],
    double cable_margin[4]);

BRACED_API int braced_compute_cable_margin_batch(
    int n_batch,
    const double *coordinate, int coordinate_stride,
    const double *velocity, int velocity_stride,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *anchor_position, int anchor_position_stride,
    double *cable_margin, int *status);

enum {
  BRACED_PLACE_INPUT = 0,
  BRACED_PLACE_REST_LENGTH = 2,
  BRACED_PLACE_SPRING_CONSTANT = 8,
  BRACED_PLACE_AXIAL_STIFFNESS = 12,
  BRACED_PLACE_DAMPING = 14,
  BRACED_PLACE_NODE_MASS = 20,
  BRACED_PLACE_NODE_LOAD = 23,
  BRACED_PLACE_GRAVITY = 35
};

enum {
  BRACED_EVENT_CABLE = 1,
  BRACED_EVENT_CONTACT = 2,
  BRACED_EVENT_CONDITION = 4
};

typedef struct {
  double time;
  int kind;
  int which;
  int direction;
} braced_event;

typedef struct {
  long long n_pieces;
  int degree;
  int n_values;
  const int *place;
  const double *time;
  const double *coefficient;
  const int *is_kink;
} braced_profile;

typedef struct {
  long long n_accepted;
  long long n_rejected;
  long long n_evaluations;
  int watch;
  int stop;
  double (*condition)(double time, const double *coordinate, const double *velocity, void *data);
  void *condition_data;
  braced_event *event;
  long long most_events;
  long long n_events;
  int is_stopped;
  const braced_profile *profile;
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
} braced_run;

enum { BRACED_RK4_WORK = 278 };
BRACED_API int braced_integrate_rk4(
    double time_start, double step, long long first_step, long long n_steps,
    double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_done, double work[278]);
BRACED_API int braced_integrate_rk4_run(
    double time_start, double step, long long first_step, long long n_steps,
    double *time, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_done, braced_run *run, double work[278]);

enum { BRACED_RK4_BATCH_WORK = 1184 };
BRACED_API int braced_integrate_rk4_batch(
    int n_batch, double time_start, double step, long long first_step, long long n_steps, double *state,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_done, int *status, double work[1184]);

enum { BRACED_RK54_WORK = 310 };
BRACED_API int braced_integrate_rk54(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_accepted, long long *n_rejected, double work[310]);
BRACED_API int braced_integrate_rk54_run(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    braced_run *run, double work[310]);

enum { BRACED_RK54_BATCH_WORK = 1968 };
BRACED_API int braced_integrate_rk54_batch(
    int n_batch, double time_end, double rtol, double atol, long long most_steps, double *time, double *step,
        double *state,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *count, int *status, double work[1968]);

enum { BRACED_RK853_WORK = 566 };
BRACED_API int braced_integrate_rk853(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_accepted, long long *n_rejected, double work[566]);
BRACED_API int braced_integrate_rk853_run(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    braced_run *run, double work[566]);

enum { BRACED_RK853_BATCH_WORK = 4128 };
BRACED_API int braced_integrate_rk853_batch(
    int n_batch, double time_end, double rtol, double atol, long long most_steps, double *time, double *step,
        double *state,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *count, int *status, double work[4128]);

enum { BRACED_TSIT5_WORK = 374 };
BRACED_API int braced_integrate_tsit5(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_accepted, long long *n_rejected, double work[374]);
BRACED_API int braced_integrate_tsit5_run(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    braced_run *run, double work[374]);

enum { BRACED_TSIT5_BATCH_WORK = 2544 };
BRACED_API int braced_integrate_tsit5_batch(
    int n_batch, double time_end, double rtol, double atol, long long most_steps, double *time, double *step,
        double *state,
    const double *input, int input_stride,
    const double *rest_length, int rest_length_stride,
    const double *spring_constant, int spring_constant_stride,
    const double *axial_stiffness, int axial_stiffness_stride,
    const double *damping, int damping_stride,
    const double *node_mass, int node_mass_stride,
    const double *node_load, int node_load_stride,
    const double *anchor_position, int anchor_position_stride,
    const double *gravity, int gravity_stride,
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *count, int *status, double work[2544]);

enum { BRACED_RADAU_WORK = 1023, BRACED_RADAU_N_TENSIONS = 2 };
extern BRACED_API const int braced_radau_member[2];
BRACED_API int braced_integrate_radau(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, double *sample_tension,
    long long *n_sampled, long long count[6], double vibration[3], double work[1023]);
BRACED_API int braced_integrate_radau_run(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, double *sample_tension,
    long long *n_sampled, double quiet, long long count[6], double vibration[3],
    braced_run *events, double work[1023]);

enum { BRACED_RODAS_WORK = 658 };
BRACED_API int braced_integrate_rodas(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    long long *n_accepted, long long *n_rejected, double work[658]);
BRACED_API int braced_integrate_rodas_run(
    double time_end, double rtol, double atol, long long most_steps,
    double *time, double *step, double state[16],
    const double input[2],
    const double rest_length[6],
    const double spring_constant[4],
    const double axial_stiffness[2],
    const double damping[6],
    const double node_mass[3],
    const double node_load[12],
    const double anchor_position[6],
    const double gravity[3],
    long long n_samples, const double *sample_time, double *sample_state, long long *n_sampled,
    braced_run *run, double work[658]);

#ifdef __cplusplus
}
#endif

#endif
