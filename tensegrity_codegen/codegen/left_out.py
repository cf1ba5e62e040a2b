"""Features that a scene does not need, and the savings of leaving them out.

Each row compares the emitted functions with the same functions of a variant that has the feature: gravity,
damping and loads as run-time arguments, tension-only cables, anchored nodes kept in the state, all three
axes, constants as arguments; and with the functions that nobody wanted.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emitter import EmittedModel, Emitter, WantedFunction
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import LeftOut
from tensegrity_codegen.tables.request import ModelRequest

Variant = tuple[Any, ModelRequest]


@dataclass(frozen=True)
class _Feature:
    """Something that a scene may lack: when, why, and the variant that has it."""

    what: str
    why: str
    is_absent: Callable[[Any, ModelRequest], bool]
    add: Callable[[Any, ModelRequest], Variant]


def _with_parameter(request: ModelRequest, **parameters: tuple[int, ...]) -> ModelRequest:
    return replace(request, parameters={**request.parameters, **parameters})


def _all(count: int) -> tuple[int, ...]:
    return tuple(range(count))


def _with_masses(structure: Structure) -> Structure:
    """Return the structure with a mass on every node, for variants in which more nodes move."""
    heavy = (structure.node_mass > 0) | structure.is_attached
    return structure.with_changes(node_mass=np.where(heavy, structure.node_mass, 1.0))


def _in_space(structure: Structure, request: ModelRequest) -> Variant:
    return _with_masses(structure).with_changes(axes=(0, 1, 2)), request


def _unanchored(structure: Structure, request: ModelRequest) -> Variant:
    free = _with_masses(structure).with_changes(node_anchored=np.zeros_like(structure.node_anchored))
    parameters = {name: indices for name, indices in request.parameters.items() if name != "anchor_position"}
    return free, replace(request, parameters=parameters)


def _springs(
    structure: Structure | BodySystem, request: ModelRequest, values: NDArray[np.float64]
) -> tuple[int, ...]:
    """Return the members with a value that are no rigid bars."""
    chosen = values != 0
    if isinstance(structure, Structure):
        chosen &= ~find_rigid_bars(structure, request)
    return tuple(int(e) for e in np.flatnonzero(chosen))


def _as_arguments(structure: Structure | BodySystem, request: ModelRequest) -> Variant:
    parameters = {
        "rest_length": _all(structure.n_members),
        "spring_constant": _springs(structure, request, structure.spring_constant),
        "axial_stiffness": _springs(structure, request, structure.axial_stiffness),
    }
    if isinstance(structure, Structure):
        shown = hide_bodies(structure)
        parameters["rest_length"] = _all(shown.n_members)
        parameters["node_mass"] = tuple(int(n) for n in np.flatnonzero(shown.node_mass))
        parameters["body_mass"] = _all(len(structure.bodies))
    return structure, _with_parameter(
        request, **{name: indices for name, indices in parameters.items() if indices}
    )


FEATURES = (
    _Feature(
        "gravity",
        "the scene has no gravity",
        lambda s, r: not s.gravity.any() and "gravity" not in r.parameters,
        lambda s, r: (s, _with_parameter(r, gravity=())),
    ),
    _Feature(
        "damping",
        "no member has damping",
        lambda s, r: not s.damping.any() and "damping" not in r.parameters,
        lambda s, r: (s, _with_parameter(r, damping=_springs(s, r, np.ones(s.n_members)))),
    ),
    _Feature(
        "loads",
        "no node has a load",
        lambda s, r: not s.node_load.any() and "node_load" not in r.parameters,
        lambda s, r: (s, _with_parameter(r, node_load=_all(s.n_nodes))),
    ),
    _Feature(
        "slack branch",
        "no cable is tension-only",
        lambda s, r: not s.tension_only.any() and not s.is_bar.all(),
        lambda s, r: (s.with_changes(tension_only=~s.is_bar), r),
    ),
    _Feature(
        "anchored coordinates",
        "anchored nodes do not move, they are constants and not in the state",
        lambda s, r: isinstance(s, Structure) and bool(s.node_anchored[:, list(s.axes)].any()),
        _unanchored,
    ),
    _Feature("axes", "the scene is planar", lambda s, r: len(s.axes) < 3, _in_space),
    _Feature(
        "run-time parameters",
        "rest lengths, stiffnesses and masses that are no run-time parameters are constants in the code",
        lambda s, r: True,
        _as_arguments,
    ),
)

UNWANTED = "unwanted functions"


def build_with(
    what: str, model: EmittedModel, request: ModelRequest, emitter: Emitter
) -> tuple[EmittedModel, ModelRequest]:
    """Return the model with the left-out feature of that name put in, and the request for it."""
    if what == UNWANTED:
        return model, replace(request, quantities=(*request.quantities, *_unwanted(model, request, emitter)))
    feature = next(candidate for candidate in FEATURES if candidate.what == what)
    variant, wider = feature.add(model.subject, request)
    wider_model = emitter.build(variant, wider)
    offered = tuple(name for name in wider.quantities if emitter.is_offered(wider_model, name))
    return wider_model, replace(wider, quantities=offered)


def account_left_out(
    model: EmittedModel, request: ModelRequest, functions: tuple[WantedFunction, ...], emitter: Emitter
) -> tuple[LeftOut, ...]:
    """Return one row for each thing that was left out and would have cost something."""
    rows = []
    for feature in FEATURES:
        if feature.is_absent(model.subject, request):
            variant, wider = build_with(feature.what, model, request, emitter)
            with_it = emitter.prune(variant, wider.quantities)
            same = tuple(f for f in functions if f.quantity.name in wider.quantities)
            rows.append(_row(feature.what, feature.why, same, with_it))
    unwanted = emitter.prune(model, _unwanted(model, request, emitter))
    why = "not requested: " + ", ".join(function.quantity.name for function in unwanted)
    rows.append(_row(UNWANTED, why, functions, (*functions, *unwanted)))
    return tuple(row for row in rows if row.functions or row.arguments or row.operations)


def _row(
    what: str, why: str, without: tuple[WantedFunction, ...], with_it: tuple[WantedFunction, ...]
) -> LeftOut:
    operations = sum(f.operations for f in with_it) - sum(f.operations for f in without)
    arguments = sum(len(f.arguments) for f in with_it) - sum(len(f.arguments) for f in without)
    return LeftOut(
        what=what,
        why=why,
        functions=len(with_it) - len(without),
        arguments=arguments,
        operations=operations,
    )


def _unwanted(model: EmittedModel, request: ModelRequest, emitter: Emitter) -> tuple[str, ...]:
    remaining_names = [name for name in model.quantities if name not in request.quantities]
    return tuple(name for name in remaining_names if emitter.is_offered(model, name))
