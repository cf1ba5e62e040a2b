"""Records of plans, made from paths and proofs; and their files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.path import PlanPath
from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint
from tensegrity_codegen.control.planning.step_problem import Margins, find_fewest_limits
from tensegrity_codegen.control.planning.targets import Targets
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.model.arrays import write_arrays
from tensegrity_codegen.runtime.records.plan_result import (
    LIMIT_WORDS,
    Binding,
    Block,
    Branch,
    Contradiction,
    PlanResult,
)
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.files import check_ending
from tensegrity_codegen.system.table_files import write_csv

UNITS = {"clearance": "m", "range": "m", "least_stiffness": "N/m"}  # of others: N
SORTED_DIGITS = 6  # digits of multipliers that order limits; equal ones stay in the order of the structure
N_NAMED = 6  # limits that a message names
ENDINGS = (".npz", ".csv")
ANOTHER_PATH = ". Another path may exist: more `attempts` look for it"


def describe_margin(plan_model: PlanModel, margins: Margins, row: int) -> str:
    """Return an exceeded limit: its name, its owner, and the excess."""
    kind, unit = margins.kind[row], UNITS.get(margins.kind[row], "N")
    name = _name(plan_model, kind, int(margins.index[row]))
    return f"{LIMIT_WORDS[kind]}{' of ' + name if name else ''}: violated by {-margins.value[row]:.6g} {unit}"


def record_infeasible(
    plan_model: PlanModel,
    targets: Targets,
    at: PlanPoint,
    proof: Certificate | Contradiction,
    message: str,
    shape: FloatArray | None = None,
) -> PlanResult:
    """Return the record of a plan that provably does not exist."""
    position = moved = None
    if shape is not None and isinstance(proof, Certificate):
        problem = plan_model.problem(plan_model.start)
        position = problem.node_position(shape)
        moved = StaticProblem.node_velocities(problem, shape, proof.displacement[:, None])[:, :, 0]
    value = targets.evaluate(plan_model.problem(at.change), at.coordinate)
    return PlanResult(
        status="infeasible",
        message=message,
        progress=np.zeros(1),
        target=value[None],
        goal=targets.goal,
        binding=((),),
        certificate=proof,
        proof_position=position,
        proof_displacement=moved,
        **_describe_points(plan_model, targets, [at]),
    )


def record_path(
    plan_model: PlanModel,
    path: PlanPath,
    time: FloatArray | None,
    warnings: tuple[str, ...],
    branches: tuple[Branch, ...],
) -> PlanResult:
    """Return the record of a path, found or blocked."""
    points = path.points
    block = None if path.is_done else _record_block(plan_model, path)
    message = f"a path of {len(points) - 1} steps reaches the target; every point is within all limits"
    return PlanResult(
        status="found" if block is None else "blocked",
        message=message if block is None else _describe_block(path, block) + ANOTHER_PATH,
        progress=np.array([point.progress for point in points]),
        target=np.array([point.target for point in points]),
        goal=path.goal,
        binding=tuple(
            _bindings(plan_model, point.margins, point.binding, point.multiplier) for point in points
        ),
        time=time,
        block=block,
        warnings=warnings,
        branches=branches,
        **_describe_points(plan_model, path.targets, [point.at for point in points]),
    )


def _describe_points(plan_model: PlanModel, targets: Targets, points: Sequence[PlanPoint]) -> dict[str, Any]:
    """Return the names and the arrays of a record that points alone determine."""
    manifest, change = plan_model.model.manifest, np.array([at.change for at in points])
    lowest = [float(at.eigenvalue[0]) if len(at.eigenvalue) else np.inf for at in points]
    return {
        "target_name": targets.names,
        "target_unit": targets.units,
        "actuator_name": plan_model.actuation.names,
        "change": change,
        "rest_length": plan_model.rest_length(change),
        "node_name": manifest.node_name,
        "member_name": manifest.member_name,
        "bar_pair_name": manifest.bar_pair_name,
        "is_cable": ~np.asarray(plan_model.structure.is_bar),
        "node_position": np.array([at.position for at in points]),
        "member_tension": np.array([at.tension for at in points]),
        "bar_distance": np.array([at.distance for at in points]),
        "smallest_eigenvalue": np.array(lowest),
        "residual": np.array([at.point.node_force for at in points]),
        "coordinate": np.array([at.model_coordinate for at in points]),
        "structure": plan_model.structure,
    }


def _record_block(plan_model: PlanModel, path: PlanPath) -> Block:
    """Return where a path ends, with the limits that bind there by the program of most progress.

    Without limits where these leave a whole step, which is rejected for another reason.
    """
    end = path.points[-1]
    program = path.build_last_program()
    bound = program.find_bound()
    full_step = min(path.most_step_progress, 1.0 - end.progress)
    if bound is None or not path.is_limited or bound.progress >= full_step:
        return Block(end.progress, end.target, float("nan"), (), path.failure)
    weight = bound.multiplier * end.margins.size[bound.binding]
    order = np.argsort(-np.round(weight / float(weight.max(initial=1e-300)), SORTED_DIGITS), kind="stable")
    binding = _bindings(plan_model, end.margins, bound.binding[order], bound.multiplier[order])
    rows, is_fewest = find_fewest_limits(program, bound)
    kinds = [(end.margins.kind[row], int(end.margins.index[row])) for row in rows]
    fewest = tuple((kind, _name(plan_model, kind, index)) for kind, index in kinds)
    return Block(end.progress, end.target, bound.progress, binding, path.failure, fewest, is_fewest)


def _bindings(
    plan_model: PlanModel, margins: Margins, rows: IntArray, multiplier: FloatArray
) -> tuple[Binding, ...]:
    bindings = []
    for row, value in zip(rows, multiplier, strict=True):
        kind = margins.kind[row]
        name = _name(plan_model, kind, int(margins.index[row]))
        unit, bound = UNITS.get(kind, "N"), float(margins.bound[row])
        if kind == "range":
            bound += float(plan_model.ranges.rest_length[margins.index[row]])
        bindings.append(Binding(kind, name, bound, float(margins.value[row]), unit, float(value)))
    return tuple(bindings)


def _name(plan_model: PlanModel, kind: str, index: int) -> str:
    """Return the member, pair of bars or actuator of a limit."""
    manifest = plan_model.model.manifest
    if kind == "clearance":
        return " and ".join(manifest.bar_pair[index])
    if kind == "range":
        return plan_model.ranges.name[index]
    return "" if kind == "least_stiffness" else manifest.member_name[index]


def _describe_block(path: PlanPath, block: Block) -> str:
    """Return the end of a path and the limits that bind."""
    values = [
        f"{name} = {value:.6g}{' ' + unit if unit else ''} of {goal:.6g}"
        for name, unit, value, goal in zip(
            path.targets.names, path.targets.units, block.target, path.goal, strict=True
        )
    ]
    names: dict[str, list[str]] = {}
    for binding in block.binding[:N_NAMED]:
        limit = f"{LIMIT_WORDS[binding.limit]} of {binding.bound:.6g} {binding.unit}"
        names.setdefault(limit, []).append(binding.name)
    bound = "; ".join(f"{limit} ({', '.join(who)})".removesuffix(" ()") for limit, who in names.items())
    n_unnamed = len(block.binding) - N_NAMED
    description = f"; binding: {bound}{f' and {n_unnamed} more' if n_unnamed > 0 else ''}" if bound else ""
    if len(block.fewest) < len(block.binding):
        alone = ", ".join(
            f"{LIMIT_WORDS[limit]} of {who}".removesuffix(" of ") for limit, who in block.fewest
        )
        description += f"; these alone block as much: {alone}"
    return f"at {block.progress:.1%} of the way, {', '.join(values)}: {block.reason}{description}"


# Plans in files: all arrays (.npz), and the inputs over time (.csv) as profiles of `simulate`.


def write_plan(found: PlanResult, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a plan to a file, whole or not at all."""
    check_ending(path, *ENDINGS)
    if Path(path).suffix.lower() == ".npz":
        write_arrays(path, _arrays(found), overwrite=overwrite)
        return
    title, column = ("progress", found.progress) if found.time is None else ("time", found.time)
    rows = np.column_stack([column, found.change]).tolist()
    write_csv(path, (title, *found.actuator_name), rows, overwrite=overwrite)


def _arrays(found: PlanResult) -> dict[str, NDArray[Any]]:
    names = (
        *("progress", "target", "goal", "change", "rest_length", "node_position", "member_tension"),
        *("bar_distance", "smallest_eigenvalue", "residual", "coordinate"),
    )
    text_names = ("target_name", "target_unit", "actuator_name", "node_name", "member_name", "bar_pair_name")
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(getattr(found, name)) for name in names}
    arrays |= {name: np.array(getattr(found, name), dtype=np.str_) for name in text_names}
    arrays |= {"status": np.array(found.status), "message": np.array(found.message)}
    rows = [(k, binding) for k, bindings in enumerate(found.binding) for binding in bindings]
    arrays["binding_step"] = np.array([k for k, _ in rows], dtype=np.int64)
    arrays["binding_limit"] = np.array([binding.limit for _, binding in rows], dtype=np.str_)
    arrays["binding_name"] = np.array([binding.name for _, binding in rows], dtype=np.str_)
    arrays["binding_multiplier"] = np.array([binding.multiplier for _, binding in rows], dtype=np.float64)
    if found.time is not None:
        arrays["time"] = found.time
    if isinstance(found.certificate, Certificate):
        arrays["certificate_displacement"] = found.certificate.displacement
        arrays["certificate_elongation"] = found.certificate.elongation
    return arrays
