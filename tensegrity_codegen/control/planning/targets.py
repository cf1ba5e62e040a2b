"""Targets bound to a model: their values, their derivatives along a path, and where they shall end."""

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from tensegrity_codegen.control.planning.shape_targets import BoundShape, bind_shape, turn_near
from tensegrity_codegen.control.planning.target_text import ANGLES, LENGTHS, TargetText, parse_shape, rewrite
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.condition import Expression, build_expression, find_quantities
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, TensegrityError
from tensegrity_codegen.tables.quantities import QUANTITIES

MovedBy = Callable[[int, float], tuple[StaticProblem, FloatArray]]

Value = TypeVar("Value")

LENGTHS_OF_MODEL = {"node_position", "member_length", "member_extension", "bar_distance"}
STEP = 1e-6  # of the size of the nodes of a shape parameter


@dataclass(frozen=True)
class BoundTarget:
    """One target: an expression, or a shape parameter; its components, and the values to reach."""

    text: str
    unit: str
    components: tuple[str, ...]
    goal: FloatArray
    expression: Expression | None = None
    shape: BoundShape | None = None
    # values of all components of the shape parameter at the last point of a path
    reference: FloatArray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components."""
        return tuple(f"{self.text}.{component}" if component else self.text for component in self.components)

    @property
    def is_length(self) -> bool:
        """Whether the values are lengths or places [m]."""
        if self.shape is not None:
            return self.unit == "m"
        names = {
            node.id for node in ast.walk(ast.parse(rewrite(self.text).strip())) if isinstance(node, ast.Name)
        }
        return names & set(QUANTITIES) <= LENGTHS_OF_MODEL

    def evaluate(self, problem: StaticProblem, coordinate: FloatArray) -> FloatArray:
        """Return the values, one for each component; NonFiniteError if one is not finite."""
        if self.shape is not None:
            value = self.shape.evaluate(problem.node_position(coordinate), self.reference)[self.shape.rows]
        else:
            assert self.expression is not None
            state = {**problem.arguments, "coordinate": coordinate, "velocity": np.zeros(problem.size)}
            value = np.array([self.expression.evaluate(state)])
        if not np.all(np.isfinite(value)):
            raise NonFiniteError(
                "the target has no finite value here",
                where=f"target {self.text}",
                given=value.tolist(),
                allowed="a finite number along the whole path",
                hint="avoid division by zero, roots of negative numbers, and sets of nodes on one line",
            )
        return value


@dataclass(frozen=True)
class Targets:
    """All targets of a plan, one after the other."""

    parts: tuple[BoundTarget, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all components."""
        return tuple(name for target in self.parts for name in target.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all components; "" for expressions, whose values are in SI units."""
        return tuple(target.unit for target in self.parts for _ in target.components)

    def evaluate(self, problem: StaticProblem, coordinate: FloatArray) -> FloatArray:
        """Return the values of all components, (n_targets,)."""
        return np.concatenate([np.zeros(0), *(target.evaluate(problem, coordinate) for target in self.parts)])

    def follow(self, position: FloatArray) -> "Targets":
        """Return the targets whose angles go on from those at node positions, also past half a turn.

        Goals that are not followed yet are reached by the shortest turn.
        """
        return Targets(tuple(_follow(target, position) for target in self.parts))

    @property
    def goal(self) -> FloatArray:
        """Values to reach, (n_targets,)."""
        return np.concatenate([np.zeros(0), *(target.goal for target in self.parts)])

    def doubt_units(self, value: FloatArray, size: float) -> list[str]:
        """Return a sentence for each place or length whose goal is farther away than a structure is large."""
        row, sentences = 0, []
        for target in self.parts:
            end = row + len(target.components)
            is_far = np.abs(target.goal - value[row:end]) > size
            for k in np.flatnonzero(is_far) if target.is_length else ():
                sentences.append(
                    f"target {target.names[k]} is {target.goal[k]:g} m, farther away than the structure is "
                    f"large ({size:.3g} m): numbers are in m, is it {target.goal[k]:g} mm?"
                )
            row = end
        return sentences

    def slopes(self, position: FloatArray, node_slope: FloatArray, moved: MovedBy, step: float) -> FloatArray:
        """Return the derivatives of all components along k directions, (n_targets, k)."""
        rows = [np.zeros((0, node_slope.shape[2]))]
        for target in self.parts:
            if target.shape is not None:
                rows.append(_slope_of_shape(target.shape, target.reference, position, node_slope))
                continue
            ends = [
                [target.evaluate(*moved(k, sign * step)) for sign in (1, -1)]
                for k in range(node_slope.shape[2])
            ]
            rows.append(np.array([(plus - minus) / (2 * step) for plus, minus in ends]).T)
        return np.concatenate(rows)


def _follow(target: BoundTarget, position: FloatArray) -> BoundTarget:
    if target.shape is None or not target.shape.turns:
        return target
    value, goal = target.shape.evaluate(position, target.reference), target.goal
    if target.reference is None and len(goal) == len(value):
        goal = turn_near(goal, value)
    return replace(target, goal=goal, reference=value)


def _slope_of_shape(
    shape: BoundShape, reference: FloatArray | None, position: FloatArray, node_slope: FloatArray
) -> FloatArray:
    """Return the derivatives of a shape parameter along directions, through the nodes that it depends on."""
    local = position - position[shape.nodes].mean(axis=0)
    step = STEP * max(float(np.abs(local[shape.nodes]).max(initial=0.0)), 1e-300)
    result = np.zeros((len(shape.components), node_slope.shape[2]))
    for node in shape.nodes:
        for axis in range(3):
            ends = []
            for sign in (1, -1):
                shifted = local.copy()
                shifted[node, axis] += sign * step
                ends.append(shape.evaluate(shifted, reference)[shape.rows])
            result += np.outer((ends[0] - ends[1]) / (2 * step), node_slope[node, axis])
    return result


def find_target_quantities(targets: Sequence[TargetText]) -> tuple[str, ...]:
    """Return the quantities that a model needs for targets."""
    quantities: dict[str, None] = {}
    for target in targets:
        if parse_shape(target.text) is None:
            expression = rewrite(target.text)
            quantities |= dict.fromkeys(_name_target_in_errors(target, partial(find_quantities, expression)))
    return tuple(quantities)


def bind_targets(targets: Sequence[TargetText], model: CompiledModel) -> Targets:
    """Return targets bound to a model."""
    return Targets(tuple(_bind(target, model) for target in targets))


def _bind(target: TargetText, model: CompiledModel) -> BoundTarget:
    call = parse_shape(target.text)
    if call is None:
        expression = _name_target_in_errors(target, partial(build_expression, rewrite(target.text), model))
        _check_axes(target, model)
        values = _convert(target, "", 1)
        return BoundTarget(target.text, "", ("",), values, expression=expression)
    shape = bind_shape(call, target.where, model)
    if len(target.values) == 1 and shape.may_pad:
        target = TargetText(target.text, (*target.values, 0.0), target.unit)
    values = _convert(target, shape.unit, len(shape.components))
    if shape.unit == "deg" and np.linalg.norm(values) >= 180 and call.name != "twist":
        raise InvalidValueError(
            "angles of half a turn or more have no direction",
            where=target.where,
            given=target.values,
            allowed="less than 180 deg",
        )
    return BoundTarget(target.text, shape.unit, shape.components, values, shape=shape)


def _check_axes(target: TargetText, model: CompiledModel) -> None:
    """Raise InvalidValueError for a target of places alone, all along axes that the scene does not have."""
    nodes = [*ast.walk(ast.parse(rewrite(target.text).strip(), mode="eval"))]
    asked = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    axes = ["xyz"[axis] for axis in model.manifest.axes]
    if asked and asked.isdisjoint(axes) and not any(isinstance(node, ast.Subscript) for node in nodes):
        raise InvalidValueError(
            "the scene has no such axis: nothing moves along it",
            where=target.where,
            given=", ".join(sorted(asked)),
            allowed=f"places along {', '.join(axes)}, the `axes` of the scene",
        )


def _convert(target: TargetText, unit: str, count: int) -> FloatArray:
    """Return the values in the unit of a target."""
    units = {"deg": ANGLES, "m": LENGTHS}.get(unit, {"": 1.0})
    if target.unit not in units:
        raise InvalidValueError(
            "the target has no such unit",
            where=target.where,
            given=target.unit,
            allowed=", ".join(name for name in units if name) or "a number in SI units without a unit",
        )
    if len(target.values) != count:
        raise InvalidValueError(
            "a wrong number of values",
            where=target.where,
            given=target.values,
            allowed="one number" if count == 1 else f"{count} numbers, separated by commas",
        )
    return np.array(target.values) * units[target.unit]


def _name_target_in_errors(target: TargetText, build: Callable[[], Value]) -> Value:
    """Return the result of `build`; errors name the target."""
    try:
        return build()
    except TensegrityError as error:
        error.where = target.where
        raise
