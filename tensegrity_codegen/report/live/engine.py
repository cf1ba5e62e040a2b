"""The compiled model inside a page: a WebAssembly module, and what calls it needs to know."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_codegen.manifest import STATUS, STATUS_TEXT, Manifest
from tensegrity_codegen.report.live.channels import pack
from tensegrity_codegen.report.live.live_scene import LiveScene
from tensegrity_codegen.report.live.sliders import Sliders, find_scales
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure

__all__ = ["add_engine"]

PULL = 0.2  # of the structure's size: displacement at which a pull of strength 1 has the usual force
PULLED = 1 / 400  # [s] between two values of the pulling force, as in worker.js
UNSHOWN = ("held", "reaction", "use")  # of stated positions only


def add_engine(
    scene: LiveScene, subject: Structure | BodySystem, manifest: Manifest, module: bytes, *, rtol: float
) -> LiveScene:
    """Return a live scene with a compiled model inside.

    Parameters
    ----------
    scene : LiveScene
        What the page shows at the start.
    subject : Structure or BodySystem
        The structure.
    manifest : Manifest
        That of the library; it has one integrator with error control.
    module : bytes
        The library for the target wasm32.
    rtol : float
        Relative tolerance of each step.

    Returns
    -------
    LiveScene
        The scene with the module and its description.
    """
    structure = outline_bodies(subject)
    integrator = manifest.integrators[0]
    sizes = {item.name: len(item.nominal) for item in manifest.arguments}
    scales = find_scales(subject, structure)
    engine: dict[str, Any] = {
        "symbol": integrator.symbol,
        "arguments": integrator.arguments,
        "work_size": integrator.work_size,
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
        "statuses": [STATUS_TEXT[name] for name in STATUS],
        "sliders": Sliders(subject, structure, manifest, scales).build(),
        "pull": {"mass": scales.mass, "stiffness": _pull_stiffness(scales.force, scales.size, scales.mass)},
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
        f"The compiled model runs in this page: {integrator.name} with error control, relative tolerance "
        f"{rtol:g} of each step; a pull acts as impulses every {PULLED * 1000:.2g} ms.",
        *(fact for fact in scene.facts if not fact.startswith("Reactions")),
    )
    return replace(scene, data={**scene.data, "engine": engine}, channels=channels, facts=facts)


def _pull_stiffness(force: float, size: float, mass: float) -> float:
    """Return the spring constant [N/m] of a pull, small enough that steps of PULLED integrate it."""
    wished = force / (PULL * size)
    return min(wished, 0.02 * mass / PULLED**2) if mass > 0 else wished
