"""Arguments of generated functions: state, inputs and run-time parameters."""

from tensegrity_codegen.tables.quantities.quantity import Quantity

# Arguments that a scene allows only above zero, or from zero on.
ABOVE_ZERO = ("rest_length", "spring_constant", "axial_stiffness", "ground", "body_mass", "body_inertia")
FROM_ZERO = ("damping", "node_mass")
GROUND_FROM_ZERO = ("friction", "dissipation")  # of the numbers of "ground"

# Units of inputs by their kind.
INPUT_UNITS = {"rest_length": "m", "temperature": "K", "force": "N", "torque": "N m"}

ARGUMENT_ROWS = (
    Quantity("coordinate", "q", "m", ("n_coordinates",), "Free node coordinates, node by node."),
    Quantity("velocity", "q'", "m/s", ("n_coordinates",), "Rates of the free node coordinates."),
    Quantity(
        "internal", "z", "m or J", ("n_internal",), "Internal states: deflections of contacts with friction."
    ),
    Quantity("input", "u", "m or N", ("n_inputs",), "Rest-length changes and forces of the actuated inputs."),
    Quantity("rest_length", "rho", "m", ("k",), "Rest lengths of the changeable members."),
    Quantity("spring_constant", "mu", "N/m", ("k",), "Spring constants of the changeable members."),
    Quantity("axial_stiffness", "EA", "N", ("k",), "Axial stiffnesses of the changeable members.", "SCS"),
    Quantity("damping", "c", "N s/m", ("k",), "Damping constants of the changeable members."),
    Quantity("node_mass", "m", "kg", ("k",), "Point masses of the changeable nodes."),
    Quantity("body_mass", "m", "kg", ("k",), "Masses of the changeable bodies."),
    Quantity(
        "body_inertia", "I", "kg m2", ("k", "n_axes"),
        "Principal inertias of the changeable bodies about their centres, ascending.",
    ),
    Quantity("node_load", "F", "N", ("k", "n_axes"), "Loads on the changeable nodes, constant in direction."),
    Quantity("anchor_position", "r_a", "m", ("k", "n_axes"), "Positions of the changeable anchored nodes."),
    Quantity("gravity", "g", "m/s2", ("n_axes",), "Gravity vector."),
    Quantity("ground", "k", "N/m, s/m, 1", ("k",), "Changeable numbers of the ground."),
    Quantity(
        "column", "S", "mixed", ("n_states", "n_columns"), "Derivatives of the state of a motion, row by row."
    ),
    Quantity(
        "direction", "P", "mixed", ("n_parameters", "n_columns"),
        "Derivatives of the run-time parameters, then of the inputs, that columns are along.",
    ),
    Quantity("state_weight", "w", "mixed", ("n_states",), "Weights of the rates of a state."),
    Quantity("tension_weight", "w", "mixed", ("n_members",), "Weights of the member tensions."),
    Quantity("margin_weight", "w", "mixed", ("n_tension_only",), "Weights of cables, one for each margin."),
)  # fmt: skip
