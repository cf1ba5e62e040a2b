"""The compiled model inside a page: a WebAssembly module, and what calls it needs to know."""

import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.live.channels import pack
from tensegrity_codegen.live.live_scene import LiveScene
from tensegrity_codegen.live.sliders import Sliders, find_scales
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.manifest import STATUS, STATUS_TEXT, Manifest

EXPLICIT = "rk54"
DAMPED_OUT = "The method radau damps vibrations of stiff bars that its steps do not resolve; rk54 does not."

MOST_WORK = 1e6  # members times explicit steps a simulated second above which radau is considered
STIFFER = 20.0  # bars to cables, as frequencies, from which radau takes so much longer steps that they pay
PULL = 0.2  # of the structure's size: displacement at which a pull of strength 1 has the usual force
UNSHOWN = ("held", "reaction", "use")  # of stated positions only


def add_engine(
    scene: LiveScene,
    subject: Structure | BodySystem,
    manifest: Manifest,
    module: bytes,
    *,
    rtol: float,
    method: str = "auto",
) -> LiveScene:
    """Return a live scene with a compiled model inside.

    Parameters
    ----------
    scene : LiveScene
        What the page shows at the start.
    subject : Structure or BodySystem
        The structure.
    manifest : Manifest
        That of the library, with its integrators with error control.
    module : bytes
        The library for the target wasm32.
    rtol : float
        Relative tolerance of each step.
    method : str
        Integrator with which the page starts; "auto" is that of `choose_method`.

    Returns
    -------
    LiveScene
        The scene with the module and its description.
    """
    structure = outline_bodies(subject)
    methods = {item.name: item for item in manifest.integrators}
    method = choose_method(structure, methods) if method == "auto" else method
    sizes = {item.name: len(item.nominal) for item in manifest.arguments}
    scales = find_scales(subject, structure)
    engine: dict[str, Any] = {
        "methods": [
            {
                "name": item.name,
                "symbol": item.symbol,
                "arguments": item.arguments,
                "work_size": item.work_size,
                "is_stiff": item.name == STIFF_INTEGRATOR,
                "tensions": item.tensions,
            }
            for item in manifest.integrators
        ],
        "method": method,
        "rtol": rtol,
        "atol": 1e-3 * rtol * scales.size,
        "axes": manifest.axes,
        "sizes": sizes,
        "changeable": [name for name in sizes if name not in ("coordinate", "velocity")],
        "functions": {
            spec.quantity: {
                "symbol": spec.symbol,
                "inputs": spec.arguments,
                "size": max(math.prod(spec.shape), 1),
            }
            for spec in manifest.functions
        },
        "statuses": [f"{name}: {STATUS_TEXT[name]}" for name in STATUS],
        "size": scales.size,
        "usual_force": scales.force,
        "sliders": Sliders(subject, structure, manifest, scales).build(),
        "pull": {
            "mass": scales.mass,
            "stiffness": scales.force / (PULL * scales.size),
            "place": sum(sizes[name] for name in manifest.driven[:-1]),
        },
    }
    places = [3 * node + axis for node, axis in manifest.coordinate_node_axis]
    channels = {name: item for name, item in scene.channels.items() if name not in UNSHOWN}
    channels |= {
        f"nominal_{item.name}": pack(np.asarray(item.nominal, dtype=float).ravel(), "float64")
        for item in manifest.arguments
    }
    channels |= {
        "coordinate_place": pack(np.asarray(places), "int32"),
        "stated_position": pack(manifest.stated_position.ravel(), "float64"),
        "module": pack(np.frombuffer(module, dtype=np.uint8), "uint8"),
    }
    facts = (
        f"The compiled model runs in this page: {' or '.join(methods)} with error control, relative "
        f"tolerance {rtol:g} of each step. A pull is a spring and a damper between node and pointer, in the "
        "equations of motion.",
        *((DAMPED_OUT,) if STIFF_INTEGRATOR in methods else ()),
        *(fact for fact in scene.facts if not fact.startswith("Reactions")),
    )
    return replace(scene, data={**scene.data, "engine": engine}, channels=channels, facts=facts)


def choose_method(structure: Structure, methods: Collection[str]) -> str:
    """Return the integrator with which a page starts: radau where stiff bars keep rk54 from real time.

    Parameters
    ----------
    structure : Structure
        The structure, or the outline of bodies.
    methods : collection of str
        The integrators of the library.

    Returns
    -------
    str
        "rk54", or STIFF_INTEGRATOR for stiff bars.

    Notes
    -----
    The largest frequency is at most the root of the largest sum of 2 k / m over the members of a node
    (Gershgorin), with spring constants k and the mass m of the node; rk54 takes 0.5 to 3 steps a radian of it
    at a tolerance of 1e-6.
    """
    if STIFF_INTEGRATOR not in methods:
        return EXPLICIT
    steps = 1.5 * _bound_frequency(structure)
    slow = 1.5 * _bound_frequency(structure, structure.tension_only)
    work = structure.n_members * steps
    return STIFF_INTEGRATOR if work > MOST_WORK and steps > STIFFER * slow else EXPLICIT


def _bound_frequency(structure: Structure, chosen: NDArray[np.bool_] | None = None) -> float:
    """Return a bound of the frequencies [rad/s] with the chosen members only."""
    ends = structure.connectivity
    spring = np.where(structure.is_rigid, 0.0, structure.mu)
    spring = spring if chosen is None else np.where(chosen, spring, 0.0)
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, ends.ravel(), np.repeat(structure.member_mass / 6, 2))
    total = np.zeros(structure.n_nodes)
    np.add.at(total, ends.ravel(), np.repeat(2.0 * spring, 2))
    moving = (mass > 0) & ~structure.node_anchored.all(axis=1)
    return float(np.sqrt((total[moving] / mass[moving]).max(initial=0.0)))
