"""The manifest of the reference model: which arguments and functions it has, in which sizes."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import ABI_VERSION, ArgumentSpec, FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import ARGUMENTS, OF_COLUMNS, PARAMETERS, QUANTITIES, WEIGHTS

Array = NDArray[np.float64]

# What the formulation in node positions offers, and so the reference.
NODE_POSITION_QUANTITIES = (
    *("member_vector", "member_length", "member_tension", "force_density", "node_speed", "node_force"),
    "node_residual",
    *("support_reaction", "elastic_energy", "potential_energy", "kinetic_energy", "total_energy"),
    *("acceleration", "state_derivative", "mass_matrix", "material_stiffness", "geometric_stiffness"),
    *("tangent_stiffness", "damping_matrix", "equilibrium_matrix", "state_jacobian", "input_jacobian"),
    *("rest_length_jacobian", "parameter_jacobian", "member_extension", "bar_distance", "bar_distance_case"),
    *("bar_distance_parameters", "bar_nearest_point", "bar_distance_jacobian", "cable_force", "member_law"),
    *("cable_margin", "switch_margin", "residual_rest_length_jacobian", "tension_jacobian"),
    "tension_rest_length_derivative",
)

OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping")


def all_parameters(structure: Structure) -> dict[str, tuple[int, ...]]:
    """Every parameter over all nodes or members."""
    nodes, members = tuple(range(structure.n_nodes)), tuple(range(structure.n_members))
    others = ("ground", "body_mass", "body_inertia")  # of what these structures do not have
    found = {name: members if name in OF_MEMBERS else nodes for name in PARAMETERS if name not in others}
    return {**found, "gravity": ()}


def full_value(structure: Structure, name: str) -> Array:
    """The structure's value of one parameter over all nodes or members, on the modelled axes."""
    axes = list(structure.axes)
    if name == "anchor_position":
        return structure.node_position[:, axes]
    if name == "node_load":
        return structure.node_load[:, axes]
    return structure.gravity[axes] if name == "gravity" else np.asarray(getattr(structure, name))


def build_manifest(structure: Structure, parameters: Mapping[str, tuple[int, ...]]) -> Manifest:
    """The manifest of a model of all quantities with these run-time parameters."""
    wanted = [n for n in ARGUMENTS if n not in (*PARAMETERS, *OF_COLUMNS, *WEIGHTS) or n in parameters]
    wanted = [n for n in wanted if (n != "input" or structure.inputs) and n != "internal"]
    arguments = tuple(argument_spec(structure, parameters, name) for name in wanted)
    sizes = count_sizes(structure, arguments)
    return Manifest(
        abi_version=ABI_VERSION,
        name=structure.name,
        scene_hash="",
        formulation="node_position",
        emitter="unrolled",
        precision="double",
        flags="reference",
        made_by={},
        axes=tuple(structure.axes),
        node_name=tuple(structure.node_name),
        member_name=tuple(structure.member_name),
        connectivity=tuple((int(i), int(j)) for i, j in structure.connectivity),
        coordinate_name=tuple(
            f"{structure.node_name[n]}_{'xyz'[a]}" for n, a in structure.coordinate_node_axis
        ),
        coordinate_node_axis=tuple((int(n), int(a)) for n, a in structure.coordinate_node_axis),
        node_position=tuple((float(x), float(y), float(z)) for x, y, z in structure.node_position),
        node_velocity=tuple((float(x), float(y), float(z)) for x, y, z in structure.node_velocity),
        input_name=tuple(item.name for item in structure.inputs),
        arguments=arguments,
        functions=tuple(function_spec(name, sizes, tuple(wanted)) for name in NODE_POSITION_QUANTITIES),
        integrators=(),
        left_out=(),
    )


def argument_spec(structure: Structure, parameters: Mapping[str, tuple[int, ...]], name: str) -> ArgumentSpec:
    """One argument with its nominal value and the names that it runs over."""
    over: tuple[str, ...] = ()
    if name in ("coordinate", "velocity"):
        field = structure.node_position if name == "coordinate" else structure.node_velocity
        node, axis = structure.coordinate_node_axis.T
        nominal = field[node, axis]
    elif name == "input":
        nominal = np.zeros(len(structure.inputs))
        over = tuple(item.name for item in structure.inputs)
    elif name == "gravity":
        nominal = full_value(structure, name)
    else:
        index = list(parameters[name])
        names = structure.member_name if name in OF_MEMBERS else structure.node_name
        nominal, over = full_value(structure, name)[index], tuple(names[k] for k in index)
    flat = tuple(float(value) for value in nominal.ravel())
    return ArgumentSpec(name, nominal.shape, ARGUMENTS[name].unit, ARGUMENTS[name].sentence, flat, over)


def count_sizes(structure: Structure, arguments: tuple[ArgumentSpec, ...]) -> dict[str, int]:
    """The numbers behind the named dimensions of the quantities' shapes."""
    n = len(structure.coordinate_node_axis)
    return {
        "n_nodes": structure.n_nodes,
        "n_members": structure.n_members,
        "n_tension_only": int(structure.tension_only.sum()),
        "n_switches": int(structure.has_switch.sum()),
        "n_axes": len(structure.axes),
        "n_law_values": 3 + len(structure.axes),
        "n_coordinates": n,
        "n_anchored_coordinates": structure.n_nodes * len(structure.axes) - n,
        "n_states": 2 * n,
        "n_inputs": len(structure.inputs),
        "n_bar_pairs": len(structure.bar_pairs),
        "n_bar_points": 2 * len(structure.bar_pairs),
        "2": 2,
        "n_parameters": sum(len(item.nominal) for item in arguments if item.name in PARAMETERS),
    }


def function_spec(quantity: str, sizes: Mapping[str, int], arguments: tuple[str, ...]) -> FunctionSpec:
    """One function in its numbered shape."""
    row = QUANTITIES[quantity]
    shape = tuple(sizes[key] for key in row.shape)
    return FunctionSpec(quantity, "", arguments, shape, row.unit, row.sentence, 0)
