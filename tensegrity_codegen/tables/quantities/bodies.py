"""Quantities of rigid bodies."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

BODIES = (
    Quantity(
        "coordinate_force", "-dU/dq + Q", "N, N m", ("n_coordinates",),
        "Static generalised force (no damping) on every coordinate; zero in equilibrium.", "SCS 8",
    ),
    Quantity(
        "unpotential_force", "Q", "N, N m", ("n_coordinates",),
        "Generalised force of torques and of forces that turn with their body, which have no potential.",
        "SCS 6",
    ),
    Quantity(
        "energy_rate", "T' + U'", "W", (),
        "Rate of the total energy: power of friction, damping and loads that have no potential.", "SCS 6, 12",
    ),
    Quantity(
        "coriolis_force", "c", "N, N m", ("n_coordinates",),
        "Terms c(q, q') of the equations of motion that are quadratic in the velocities.", "SCS 9",
    ),
    Quantity(
        "load_matrix", "H", "1, m", ("n_coordinates", "n_inputs"),
        "Load matrix: H F balances the generalised force of the force and torque inputs F.", "SCS 10",
        sparse=True,
    ),
    Quantity(
        "node_jacobian", "dr/dq", "1, m", ("n_node_components", "n_coordinates"),
        "Jacobian of the node positions, node by node, to the coordinates.", "SCS 6", sparse=True,
    ),
    Quantity(
        "chart_margin", "sin", "1", ("n_charts",),
        "Sine of the angle from each bar to the pole of its chart, cos(phi) of a rigid body; 0 at the pole.",
        "SCS 3",
    ),
    Quantity(
        "body_position", "r_c", "m", ("n_bodies", "n_axes"),
        "Positions of the centres of mass of free bodies.",
    ),
    Quantity(
        "body_velocity", "r_c'", "m/s", ("n_bodies", "n_axes"),
        "Velocities of the centres of mass of free bodies.",
    ),
    Quantity(
        "body_axes", "R", "1", ("n_bodies", "n_rotation"),
        "Rotation matrix of each free body, row by row: its columns are the axes of the body's frame.",
    ),
    Quantity(
        "body_angular_velocity", "omega", "rad/s", ("n_bodies", "n_axes"),
        "Angular velocity of each free body, in the axes of its frame.",
    ),
)  # fmt: skip
