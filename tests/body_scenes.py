"""Body systems for tests: one that has everything, the shipped ones, and their quantities in CasADi."""

import copy
from functools import cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
from tensegrity_codegen.scene.read import parse_scene, read_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import run_in_casadi

Array = NDArray[np.float64]

# Every kind of body, chart, law, load and input at once.
EVERYTHING: dict[str, Any] = {
    "name": "everything",
    "gravity": [0.3, -0.2, -9.81],
    "classes": {
        "rope": {"kind": "cable", "spring_constant": 80.0, "rest_length": 0.4},
        "wire": {"kind": "cable", "axial_stiffness": 50.0, "strain": 0.1, "tension_only": False},
    },
    "bodies": {
        "leg": {
            "kind": "bar", "length": 0.9, "mass": 0.4, "anchor": "plate.corner", "end": "B",
            "azimuth_deg": 80, "declination_deg": 130, "azimuth_rate_deg": 20, "polar_rate_deg": -30,
        },
        "ground": {"kind": "fixed", "points": {"a": [0, 0, 0], "b": [1, 0.2, 0]}},
        "mast": {
            "kind": "bar", "length": 1.1, "density": 1800, "radius": 0.01, "inner_radius": 0.005,
            "anchor": "ground.a", "azimuth_offset_deg": 35, "azimuth_deg": -10, "elevation_deg": 50,
            "azimuth_rate_deg": 15,
        },
        "boom": {
            "kind": "bar", "length": 0.7, "mass": 0.2, "inertia": 0.03, "anchor": "mast.B",
            "direction": [0.2, 0.8, 0.5], "spin": "none", "azimuth_rate_deg": -40,
        },
        "stick": {
            "kind": "bar", "length": 0.6, "mass": 0.3, "centre": [0.8, 0.6, 0.7], "polar_axis": "x",
            "azimuth_deg": 20, "declination_deg": 70, "centre_velocity": [0.1, -0.2, 0.3],
        },
        "plate": {
            "kind": "rigid", "mass": 0.8, "inertia": [[0.04, 0.01, 0], [0.01, 0.05, 0.002], [0, 0.002, 0.07]],
            "points": {"corner": [0.3, 0.1, 0.05], "edge": [-0.2, 0.2, 0]}, "centre": [0.2, 0.7, 1.2],
            "psi_deg": 30, "phi_deg": -20, "theta_deg": 15, "phi_rate_deg": 50,
            "centre_velocity": [0, 0.1, 0],
        },
    },
    "tendons": {
        "t1": {"class": "rope", "points": ["ground.b", "stick.A"], "damping": 0.4},
        "t2": {"class": "wire", "points": ["mast.B", "plate.edge"]},
        "t3": {"class": "rope", "points": ["boom.B", "stick.B"], "tension_only": False, "damping": 0.2},
        "t4": {"class": "rope", "points": ["leg.A", "ground.a"], "rest_length": 5.0},
        "t5": {"class": "wire", "points": ["plate.centre", "boom.A"]},
    },
    "joint_friction": [
        {"bodies": ["mast", "ground"], "coefficient": -0.05},
        {"bodies": ["boom", "mast"], "coefficient": -0.02},
        {"bodies": ["ground", "plate"], "coefficient": -0.01},
        {"bodies": ["leg", "plate"], "coefficient": -0.03},
    ],
    "loads": [
        {"point": "stick.A", "force": [1, 2, 3]},
        {"point": "plate.edge", "force": [0.5, 0, 1], "frame": "body"},
        {"body": "mast", "torque": [0.1, 0.2, -0.1]},
        {"body": "plate", "torque": [0.1, 0, 0.2], "frame": "body"},
    ],
    "inputs": [
        {"name": "winch", "kind": "rest_length", "members": ["rope"]},
        {"name": "push", "kind": "point_force", "points": ["leg.A", "stick.B"], "direction": [0, 3, 4]},
        {"name": "thrust", "kind": "point_force", "points": ["plate.corner"], "direction": [1, 0, 1],
         "frame": "body"},
        {"name": "turn", "kind": "torque", "bodies": ["boom", "plate"], "direction": [0, 0, 2]},
        {"name": "spin", "kind": "torque", "bodies": ["plate"], "direction": [0, 1, 1], "frame": "body"},
    ],
}  # fmt: skip


def assemble_document(document: dict[str, Any]) -> tuple[BodySystem, ModelRequest]:
    """Return the system and request of a scene document."""
    return assemble_bodies(parse_scene(copy.deepcopy(document), "bodies.toml"), "bodies.toml")


@cache
def example(name: str) -> BodySystem:
    """Return a shipped scene of bodies."""
    path = files("tensegrity_codegen.scene").joinpath("examples", f"{name}.toml")
    return assemble_bodies(read_scene(str(path)), name)[0]


class BodyEvaluator:
    """Quantities of one system in CasADi's virtual machine; arguments default to the system's own."""

    def __init__(self, system: BodySystem, parameters: dict[str, tuple[int, ...]] | None = None) -> None:
        self.system = system
        self.model = build_model(system, ModelRequest((), parameters=parameters or {}, formulation="bodies"))
        self.nominal = {name: item.nominal for name, item in self.model.arguments.items()}
        self.functions: dict[str, PrunedFunction] = {}

    def __call__(self, quantity: str, **changes: Array) -> Array:
        if quantity not in self.functions:
            (self.functions[quantity],) = prune(self.model, (quantity,))
        return run_in_casadi(self.functions[quantity], {**self.nominal, **changes})

    def node_acceleration(self, **state: Array) -> Array:
        """Return r'' = J q'' + dJ/dt q' of all nodes, by differentiating node_velocity along the motion."""
        q, v = self.model.arguments["coordinate"].symbol, self.model.arguments["velocity"].symbol
        velocity = self.model.expression("node_velocity")
        slope = ca.jtimes(ca.vec(velocity), ca.vertcat(q, v), self.model.expression("state_derivative"))
        values = {**self.nominal, **state}
        names = [name for name, item in self.model.arguments.items() if item.symbol.numel()]
        function = ca.Function("a", [self.model.arguments[name].symbol for name in names], [slope])
        return np.array(function(*[values[name].T for name in names])).reshape(-1, 3)


def random_state(system: BodySystem, seed: int, spread: float = 0.2) -> dict[str, Array]:
    """Return coordinates near the system's own, velocities and inputs of order one."""
    rng = np.random.default_rng(seed)
    n = system.n_coordinates
    return {
        "coordinate": system.coordinate + spread * rng.uniform(-1, 1, n),
        "velocity": rng.uniform(-1, 1, n),
        "input": rng.uniform(-0.2, 0.2, len(system.inputs)),
    }
