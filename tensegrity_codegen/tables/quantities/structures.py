"""Quantities of any structure: member laws, energies, motion, stiffness, Jacobians."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

STRUCTURES = (
    Quantity(
        "spring_tension", "t_s", "N", ("n_members",),
        "Tensions of springs at rest, mu_e (l_e - rho_e); zero in slack cables and in rigid bars.",
    ),
    Quantity(
        "member_law", "rho, mu, c, a", "m, N/m, N s/m, m", ("n_members", "n_law_values"),
        "Rest length, spring constant and damping, member by member, and what anchored ends add to d_e.",
    ),
    Quantity("elastic_energy", "U_e", "J", (), "Strain energy sum mu_e (l_e - rho_e)^2 / 2 of taut members."),
    Quantity("potential_energy", "U", "J", (), "Strain energy minus the work of gravity and loads."),
    Quantity("kinetic_energy", "T", "J", (), "Kinetic energy q'^T H q' / 2."),
    Quantity("total_energy", "T + U", "J", (), "Kinetic plus potential energy."),
    Quantity(
        "acceleration", "q''", "m/s2", ("n_coordinates",),
        "Accelerations q'' = H^-1 f of the free coordinates.",
    ),
    Quantity("state_derivative", "x'", "m/s, m/s2", ("n_states",), "Derivative of the state x = (q, q')."),
    Quantity(
        "mass_matrix", "H", "kg", ("n_coordinates", "n_coordinates"),
        "Mass matrix; a uniform bar adds (m/6) [2 1; 1 2] kron I.", "S&K 2; consistent mass of a uniform bar",
        sparse=True,
    ),
    Quantity(
        "material_stiffness", "K_M", "N/m", ("n_coordinates", "n_coordinates"),
        "Material part of the tangent stiffness: mu_e d d^T / l^2 of each taut member.", "S&K 5", sparse=True,
    ),
    Quantity(
        "geometric_stiffness", "K_G", "N/m", ("n_coordinates", "n_coordinates"),
        "Geometric part of the tangent stiffness: t_e/l_e (I - d d^T / l^2).", "S&K 5", sparse=True,
    ),
    Quantity(
        "tangent_stiffness", "K", "N/m", ("n_coordinates", "n_coordinates"),
        "Tangent stiffness K = K_M + K_G, the Hessian of the potential energy.", "S&K 5", sparse=True,
    ),
    Quantity(
        "damping_matrix", "C", "N s/m", ("n_coordinates", "n_coordinates"),
        "Damping matrix -df/dq': c_e d d^T / l^2 of each taut member.", "S&K 2", sparse=True,
    ),
    Quantity(
        "equilibrium_matrix", "A", "1", ("n_coordinates", "n_members"),
        "Equilibrium matrix: A t balances the loads on the free coordinates.", "S&K 2", sparse=True,
    ),
    Quantity(
        "state_jacobian", "dx'/dx", "1/s, 1/s2", ("n_states", "n_states"),
        "Jacobian of the state derivative to the state.", "S&K 5", sparse=True,
    ),
    Quantity(
        "input_jacobian", "dx'/du", "m/s2 per input", ("n_states", "n_inputs"),
        "Jacobian of the state derivative to the inputs.", "S&K 5", sparse=True,
    ),
    Quantity(
        "rest_length_jacobian", "dx'/drho", "1/s2", ("n_states", "n_members"),
        "Jacobian of the state derivative to the rest lengths of all members.", "S&K 5", sparse=True,
    ),
    Quantity(
        "residual_rest_length_jacobian", "-d2U/dq drho", "N/m", ("n_coordinates", "n_members"),
        "Derivative of the static force on every coordinate, `node_residual` or `coordinate_force`, to the "
        "rest lengths of all members; zero in the columns of slack cables and rigid bars.",
        sparse=True,
    ),
    Quantity(
        "tension_jacobian", "dt/dq", "N/m", ("n_members", "n_coordinates"),
        "Derivative of the member tensions to the coordinates at constant rest lengths; zero in the rows of "
        "slack cables and of rigid bars, whose tensions are multipliers.",
        sparse=True,
    ),
    Quantity(
        "parameter_jacobian", "dx'/dp", "mixed", ("n_states", "n_parameters"),
        "Jacobian of the state derivative to all run-time parameters.", "S&K 5", sparse=True,
    ),
    Quantity(
        "column_rate", "x', S'", "mixed", ("n_followed",),
        "Rates of a state, and behind them, row by row, those of the derivatives of a motion, "
        "dx'/dx S + dx'/dp P.",
        "Dickinson and Gelinas 1976",
    ),
    Quantity(
        "tension_column", "dt", "mixed", ("n_members", "n_columns"),
        "Derivatives of the member tensions along a motion, dt/dx S + dt/dp P.",
    ),
    Quantity(
        "margin_column", "dg", "mixed", ("n_tension_only", "n_columns"),
        "Derivatives of the margins of cables, dg/dx S + dg/dp P.", "Aizerman and Gantmacher 1958",
    ),
    Quantity(
        "margin_jump", "w [x']", "mixed", ("n_states",),
        "What rates of a state jump by as cables are pulled taut, from no tension to what they have, times a "
        "weight each.",
        "Aizerman and Gantmacher 1958",
    ),
    Quantity(
        "adjoint_rate", "(dx'/d(x, p))^T w", "mixed", ("n_varied",),
        "Derivative of w . x' to the state, then to the run-time parameters and inputs.",
        "Hairer, Norsett and Wanner 1993, II.15",
    ),
    Quantity(
        "adjoint_tension", "(dt/d(x, p))^T w", "mixed", ("n_varied",),
        "Derivative of w . t, of the member tensions t, to the state, then to the run-time parameters and "
        "inputs.",
    ),
    Quantity(
        "adjoint_margin", "(dg/d(x, p))^T w", "mixed", ("n_varied",),
        "Derivative of w . g, of the margins g of cables, to the state, then to the run-time parameters and "
        "inputs.",
        "Aizerman and Gantmacher 1958",
    ),
    Quantity(
        "cable_margin", "g", "m", ("n_tension_only",),
        "Margins of cables that go slack, min(l_e - rho_e, l_e - rho_e + c_e l_e' / mu_e): each pulls while "
        "its margin is positive.",
    ),
    Quantity(
        "switch_margin", "g_s", "m", ("n_switches",),
        "Margins of the switches of member laws: where one changes its sign, the slope of the law jumps.",
    ),
)  # fmt: skip
