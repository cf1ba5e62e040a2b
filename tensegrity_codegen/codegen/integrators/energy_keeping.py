"""Integrators that keep the energy: which models can have them, and what the template reads.

After each step velocities are changed by as little as brings the energy back, in the metric of the mass
matrix, along what of them is no rigid motion, so that momentum and angular momentum stay.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.codegen.integrators.work_memory import count_bytes
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.request import ModelRequest

KEEP_CHOICES = ("energy",)
KEPT_QUANTITIES = ("total_energy", "mass_matrix", "energy_rate")
N_RIGID = {1: 1, 2: 3, 3: 6}  # axes -> rigid motions


def check_keep(request: ModelRequest, name: str) -> None:
    """Raise FormulationError for what no integrator can keep in this formulation; name: of the scene."""
    for word in request.keep:
        if word not in KEEP_CHOICES:
            raise FormulationError(
                "unknown thing to keep", where="model.keep", given=word, hint=suggest(word, KEEP_CHOICES)
            )
    in_nodes = [item.name for item in FORMULATIONS.values() if item.in_nodes]
    if request.keep and (request.formulation not in in_nodes or request.precision != "double"):
        raise FormulationError(
            "the energy is kept in node coordinates and double precision alone",
            where=f"{name}: model.keep",
            given=f"{request.formulation}, {request.precision}",
            allowed=f"formulations {', '.join(in_nodes)} in double precision",
            hint="omit it, and tighten the tolerance",
        )


def check_conservative(model: EmittedModel, functions: Mapping[str, FunctionSpec]) -> None:
    """Raise FormulationError for a model whose motion does not keep its energy."""
    rate = functions.get("energy_rate")
    depends = "velocity" in functions["acceleration"].arguments if rate is None else bool(rate.arguments)
    if depends:
        raise FormulationError(
            "nothing keeps the energy where damping takes some",
            where=f"{model.name}: model.keep",
            given="energy",
            allowed="structures without damping",
            hint="set all damping to 0, or leave `keep` out",
        )


def keeper_memory(model: EmittedModel, functions: Mapping[str, FunctionSpec]) -> int:
    """Return the bytes of work memory that it takes; raises as check_conservative."""
    check_conservative(model, functions)
    sizes = {"N": len(model.frame.coordinate_name), "N_MASSES": _mass_size(functions["mass_matrix"])}
    return count_bytes("energy_memory", "energy.h", sizes)


def keeper_context(manifest: Manifest, functions: Mapping[str, FunctionSpec]) -> dict[str, Any]:
    """Return what the template reads."""
    mass = functions["mass_matrix"]
    axes, n = len(manifest.axes), len(manifest.coordinate_name)
    is_free = n == axes * len(manifest.node_name)
    pattern = mass.pattern
    diagonal = pattern is None or (
        len(pattern.row) == n and np.array_equal(pattern.row, np.arange(n, dtype=np.int32))
    )
    return {
        "energy_arguments": functions["total_energy"].arguments,
        "mass_arguments": mass.arguments,
        "mass_size": _mass_size(mass),
        "is_mass_diagonal": diagonal,
        "axes": axes,
        "rigid": N_RIGID[axes] if is_free else 0,
    }


def _mass_size(mass: FunctionSpec) -> int:
    return len(mass.pattern.row) if mass.pattern is not None else int(np.prod(mass.shape))
