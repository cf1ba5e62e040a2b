"""Quantities of node distances."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

DISTANCES = (
    Quantity(
        "difference_map", "D", "1", ("n_differences", "n_components"),
        "Map from positions of all nodes, node by node, to their differences over the pairs.",
        "S&K 3",
        sparse=True,
    ),
    Quantity(
        "centre_map", "J_c", "1", ("n_centres", "n_components"),
        "Map from positions of all nodes, node by node, to the centres of mass.",
        "S&K 3",
        sparse=True,
    ),
    Quantity(
        "distance_force", "f", "N", ("n_coordinates",),
        "Forces of pairs that move the structure as all forces do, then those on the centre of mass.",
        "S&K 3",
    ),
    Quantity(
        "distance_inertia", "H_delta, M", "kg", ("n_coordinates", "n_coordinates"),
        "Diagonal inertia of all pairs, H = D^T H_delta D + J_c^T M J_c.", "S&K 4", sparse=True,
    ),
    Quantity(
        "distance_inertia_inverse", "D H^-1 D^T, M^-1", "1/kg", ("n_coordinates", "n_coordinates"),
        "What turns forces of pairs into accelerations, block by block.", "S&K 4", sparse=True,
    ),
    Quantity(
        "constraint_basis", "L", "1", ("n_coordinates", "n_constraints"),
        "Basis of the constraints between differences, L^T D = 0.", "S&K 4", sparse=True,
    ),
    Quantity(
        "constraint_residual", "L^T delta", "m", ("n_constraints",),
        "Violation of the constraints between differences; every Runge-Kutta method keeps it.", "S&K 4",
    ),
    Quantity(
        "consistent_coordinate", "P delta", "m", ("n_coordinates",),
        "Coordinates with every closing pair of a cycle set to the sum along the spanning forest.", "S&K 4",
    ),
    Quantity(
        "consistent_velocity", "P delta'", "m/s", ("n_coordinates",),
        "Velocities with every closing pair of a cycle set to the sum along the spanning forest.", "S&K 4",
    ),
    Quantity(
        "multiplier", "lambda", "N", ("n_constraints",),
        "Multipliers of the constraints, H_delta delta'' + L lambda = f.", "S&K 7",
    ),
    Quantity(
        "rigidity_error", "|t/mu|", "m", ("n_bars",),
        "Estimate of the length of each rigid bar that its stiffness would change and the model neglects.",
    ),
    Quantity(
        "saddle_matrix", "[H L; L^T 0]", "kg, 1", ("n_saddle", "n_saddle"),
        "Matrix of the saddle system; n_saddle = n_coordinates + n_constraints.", "S&K 7", sparse=True,
    ),
    Quantity(
        "force_jacobian", "df/ddelta", "N/m", ("n_coordinates", "n_coordinates"),
        "Block-diagonal Jacobian of the member forces to the differences.", "S&K 5", sparse=True,
    ),
    Quantity(
        "control_jacobian", "df/du", "N/m", ("n_coordinates", "n_inputs"),
        "Jacobian of the member forces to the rest-length inputs, one column block an actuated member.",
        "S&K 6", sparse=True,
    ),
)  # fmt: skip
