"""The table of every quantity and argument: name, symbol, unit, shape, sentence, source.

Registered once; header comments, docstrings, help texts and shape checks all read it from here.
Shapes name dimensions: `n_nodes`, `n_members`, `n_axes`, `n_coordinates` (free node coordinates),
`n_states` = 2 n_coordinates, `n_inputs`, `n_parameters` (all run-time parameters, stacked in argument
order), `n_bar_pairs`, `n_bar_points` = 2 n_bar_pairs; `k` is the number of nodes or members that the scene
keeps changeable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tensegrity_codegen.errors import UnknownNameError, suggest

__all__ = ["ARGUMENTS", "PARAMETERS", "QUANTITIES", "Quantity", "find_quantity"]


@dataclass(frozen=True)
class Quantity:
    """One row of the table; `sparse` results are handed out as compressed columns."""

    name: str
    symbol: str
    unit: str
    shape: tuple[str, ...]
    sentence: str
    source: str = "S&K 2"
    sparse: bool = False
    needs_mass: bool = False

    @property
    def over_bar_pairs(self) -> bool:
        """Whether the quantity runs over pairs of bars."""
        return bool({"n_bar_pairs", "n_bar_points"}.intersection(self.shape))


def _table(*rows: Quantity) -> Mapping[str, Quantity]:
    return MappingProxyType({row.name: row for row in rows})


ARGUMENTS = _table(
    Quantity("coordinate", "q", "m", ("n_coordinates",), "Free node coordinates, node by node."),
    Quantity("velocity", "q'", "m/s", ("n_coordinates",), "Rates of the free node coordinates."),
    Quantity("input", "u", "m or N", ("n_inputs",), "Rest-length changes and forces of the actuated inputs."),
    Quantity("rest_length", "rho", "m", ("k",), "Rest lengths of the changeable members."),
    Quantity("spring_constant", "mu", "N/m", ("k",), "Spring constants of the changeable members."),
    Quantity("axial_stiffness", "EA", "N", ("k",), "Axial stiffnesses of the changeable members.", "SCS"),
    Quantity("damping", "c", "N s/m", ("k",), "Damping constants of the changeable members."),
    Quantity("node_mass", "m", "kg", ("k",), "Point masses of the changeable nodes."),
    Quantity("node_load", "F", "N", ("k", "n_axes"), "Loads on the changeable nodes, constant in direction."),
    Quantity("anchor_position", "r_a", "m", ("k", "n_axes"), "Positions of the changeable anchored nodes."),
    Quantity("gravity", "g", "m/s2", ("n_axes",), "Gravity vector."),
)

PARAMETERS = tuple(name for name in ARGUMENTS if name not in ("coordinate", "velocity", "input"))

QUANTITIES = _table(
    Quantity("node_position", "r", "m", ("n_nodes", "n_axes"), "Positions of all nodes."),
    Quantity("node_velocity", "r'", "m/s", ("n_nodes", "n_axes"), "Velocities of all nodes."),
    Quantity("member_vector", "d", "m", ("n_members", "n_axes"), "Member vectors d_e = r_i - r_j."),
    Quantity("member_length", "l", "m", ("n_members",), "Member lengths l_e = |d_e|."),
    Quantity(
        "member_tension",
        "t",
        "N",
        ("n_members",),
        "Member tensions t_e = mu_e (l_e - rho_e) + c_e l_e', positive in tension; zero in slack cables.",
    ),
    Quantity("force_density", "t/l", "N/m", ("n_members",), "Force densities t_e / l_e."),
    Quantity(
        "node_force", "f", "N", ("n_nodes", "n_axes"), "Sum of member forces, weight and loads on every node."
    ),
    Quantity(
        "node_residual",
        "-dU/dq",
        "N",
        ("n_coordinates",),
        "Static force (no damping) on every free coordinate; zero in equilibrium.",
    ),
    Quantity(
        "support_reaction",
        "R",
        "N",
        ("n_anchored_coordinates",),
        "Static force that the anchors exert on the structure, anchored coordinate by coordinate.",
    ),
    Quantity("elastic_energy", "U_e", "J", (), "Strain energy sum mu_e (l_e - rho_e)^2 / 2 of taut members."),
    Quantity("potential_energy", "U", "J", (), "Strain energy minus the work of gravity and loads."),
    Quantity("kinetic_energy", "T", "J", (), "Kinetic energy q'^T H q' / 2.", needs_mass=True),
    Quantity("total_energy", "T + U", "J", (), "Kinetic plus potential energy.", needs_mass=True),
    Quantity(
        "acceleration",
        "q''",
        "m/s2",
        ("n_coordinates",),
        "Accelerations q'' = H^-1 f of the free coordinates.",
        needs_mass=True,
    ),
    Quantity(
        "state_derivative",
        "x'",
        "m/s, m/s2",
        ("n_states",),
        "Derivative of the state x = (q, q').",
        needs_mass=True,
    ),
    Quantity(
        "mass_matrix",
        "H",
        "kg",
        ("n_coordinates", "n_coordinates"),
        "Mass matrix; a uniform bar adds (m/6) [2 1; 1 2] kron I.",
        "S&K 2; consistent mass of a uniform bar",
        True,
        True,
    ),
    Quantity(
        "material_stiffness",
        "K_M",
        "N/m",
        ("n_coordinates", "n_coordinates"),
        "Material part of the tangent stiffness: mu_e d d^T / l^2 of each taut member.",
        "S&K 5",
        True,
    ),
    Quantity(
        "geometric_stiffness",
        "K_G",
        "N/m",
        ("n_coordinates", "n_coordinates"),
        "Geometric part of the tangent stiffness: t_e/l_e (I - d d^T / l^2).",
        "S&K 5",
        True,
    ),
    Quantity(
        "tangent_stiffness",
        "K",
        "N/m",
        ("n_coordinates", "n_coordinates"),
        "Tangent stiffness K = K_M + K_G, the Hessian of the potential energy.",
        "S&K 5",
        True,
    ),
    Quantity(
        "damping_matrix",
        "C",
        "N s/m",
        ("n_coordinates", "n_coordinates"),
        "Damping matrix -df/dq': c_e d d^T / l^2 of each taut member.",
        "S&K 2",
        True,
    ),
    Quantity(
        "equilibrium_matrix",
        "A",
        "1",
        ("n_coordinates", "n_members"),
        "Equilibrium matrix: A t balances the loads on the free coordinates.",
        "S&K 2",
        True,
    ),
    Quantity(
        "coordinate_force",
        "-dU/dq + Q",
        "N, N m",
        ("n_coordinates",),
        "Static generalised force (no damping) on every coordinate; zero in equilibrium.",
        "SCS 8",
    ),
    Quantity(
        "unpotential_force",
        "Q",
        "N, N m",
        ("n_coordinates",),
        "Generalised force of torques and of forces that turn with their body, which have no potential.",
        "SCS 6",
    ),
    Quantity(
        "energy_rate",
        "T' + U'",
        "W",
        (),
        "Rate of the total energy: power of friction, damping and loads that have no potential.",
        "SCS 6, 12",
    ),
    Quantity(
        "coriolis_force",
        "c",
        "N, N m",
        ("n_coordinates",),
        "Terms c(q, q') of the equations of motion that are quadratic in the velocities.",
        "SCS 9",
        needs_mass=True,
    ),
    Quantity(
        "load_matrix",
        "H",
        "1, m",
        ("n_coordinates", "n_inputs"),
        "Load matrix: H F balances the generalised force of the force and torque inputs F.",
        "SCS 10",
        True,
    ),
    Quantity(
        "node_jacobian",
        "dr/dq",
        "1, m",
        ("n_node_components", "n_coordinates"),
        "Jacobian of the node positions, node by node, to the coordinates.",
        "SCS 6",
        True,
    ),
    Quantity(
        "chart_margin",
        "sin",
        "1",
        ("n_charts",),
        "Sine of the angle from each bar to the pole of its chart, cos(phi) of a rigid body; 0 at the pole.",
        "SCS 3",
    ),
    Quantity(
        "state_jacobian",
        "dx'/dx",
        "1/s, 1/s2",
        ("n_states", "n_states"),
        "Jacobian of the state derivative to the state.",
        "S&K 5",
        True,
        True,
    ),
    Quantity(
        "input_jacobian",
        "dx'/du",
        "m/s2 per input",
        ("n_states", "n_inputs"),
        "Jacobian of the state derivative to the inputs.",
        "S&K 5",
        True,
        True,
    ),
    Quantity(
        "rest_length_jacobian",
        "dx'/drho",
        "1/s2",
        ("n_states", "n_members"),
        "Jacobian of the state derivative to the rest lengths of all members.",
        "S&K 5",
        True,
        True,
    ),
    Quantity(
        "parameter_jacobian",
        "dx'/dp",
        "mixed",
        ("n_states", "n_parameters"),
        "Jacobian of the state derivative to all run-time parameters.",
        "S&K 5",
        True,
        True,
    ),
    Quantity(
        "member_extension",
        "l - rho",
        "m",
        ("n_members",),
        "Extensions l_e - rho_e of members; negative in slack cables.",
    ),
    Quantity(
        "bar_distance",
        "D",
        "m",
        ("n_bar_pairs",),
        "Distances between the surfaces of bars with round ends, pair by pair; negative where they overlap.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_case",
        "k",
        "1",
        ("n_bar_pairs",),
        "Which case of the geometry of two bars holds, 1 to 11.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_parameters",
        "(s, t)",
        "1",
        ("n_bar_pairs", "2"),
        "Where the nearest points are on both axes, from 0 (first node of the bar) to 1 (second node).",
        "LIN 3.2",
    ),
    Quantity(
        "bar_nearest_point",
        "P, Q",
        "m",
        ("n_bar_points", "n_axes"),
        "Nearest points of the axes of two bars, first and second, pair by pair.",
        "LIN 3.2",
    ),
    Quantity(
        "bar_distance_jacobian",
        "dD/dq",
        "1",
        ("n_bar_pairs", "n_coordinates"),
        "Jacobian of the distances between bars; where axes meet, of one of the two sides.",
        "LIN 3.2",
        True,
    ),
    Quantity("node_position", "r", "m", ("n_nodes", "n_axes"), "Positions of all nodes.", "S&K 3"),
    Quantity("node_velocity", "r'", "m/s", ("n_nodes", "n_axes"), "Velocities of all nodes.", "S&K 3"),
    Quantity(
        "distance_force",
        "f",
        "N",
        ("n_coordinates",),
        "Forces of pairs that move the structure as all forces do, then those on the centre of mass.",
        "S&K 3",
    ),
    Quantity(
        "distance_inertia",
        "H_delta, M",
        "kg",
        ("n_coordinates", "n_coordinates"),
        "Diagonal inertia of all pairs, H = D^T H_delta D + J_c^T M J_c.",
        "S&K 4",
        True,
        True,
    ),
    Quantity(
        "distance_inertia_inverse",
        "D H^-1 D^T, M^-1",
        "1/kg",
        ("n_coordinates", "n_coordinates"),
        "What turns forces of pairs into accelerations, block by block.",
        "S&K 4",
        True,
        True,
    ),
    Quantity(
        "constraint_basis",
        "L",
        "1",
        ("n_coordinates", "n_constraints"),
        "Basis of the constraints between differences, L^T D = 0.",
        "S&K 4",
        True,
    ),
    Quantity(
        "constraint_residual",
        "L^T delta",
        "m",
        ("n_constraints",),
        "Violation of the constraints between differences; every Runge-Kutta method keeps it.",
        "S&K 4",
    ),
    Quantity(
        "consistent_coordinate",
        "P delta",
        "m",
        ("n_coordinates",),
        "Coordinates with every closing pair of a cycle set to the sum along the spanning forest.",
        "S&K 4",
    ),
    Quantity(
        "consistent_velocity",
        "P delta'",
        "m/s",
        ("n_coordinates",),
        "Velocities with every closing pair of a cycle set to the sum along the spanning forest.",
        "S&K 4",
    ),
    Quantity(
        "multiplier",
        "lambda",
        "N",
        ("n_constraints",),
        "Multipliers of the constraints, H_delta delta'' + L lambda = f.",
        "S&K 7",
        needs_mass=True,
    ),
    Quantity(
        "saddle_matrix",
        "[H L; L^T 0]",
        "kg, 1",
        ("n_saddle", "n_saddle"),
        "Matrix of the saddle system; n_saddle = n_coordinates + n_constraints.",
        "S&K 7",
        True,
        True,
    ),
    Quantity(
        "force_jacobian",
        "df/ddelta",
        "N/m",
        ("n_coordinates", "n_coordinates"),
        "Block-diagonal Jacobian of the member forces to the differences.",
        "S&K 5",
        True,
    ),
    Quantity(
        "control_jacobian",
        "df/du",
        "N/m",
        ("n_coordinates", "n_inputs"),
        "Jacobian of the member forces to the rest-length inputs, one column block an actuated member.",
        "S&K 6",
        True,
    ),
)


def find_quantity(name: str) -> Quantity:
    """Return the table's row of `name`; an unknown name raises UnknownNameError with the known ones."""
    if name not in QUANTITIES:
        raise UnknownNameError(
            "unknown quantity", where="quantities", given=name, hint=suggest(name, QUANTITIES)
        )
    return QUANTITIES[name]
