"""A condition on a motion, written as an expression over quantities: `member_length["c1"] - 0.5`.

What it may say is in condition_text.py. An event is where its sign changes. One comparison of two such
parts, `top.z < 0.1`, stands for a difference that is positive where it holds. `min`, `max` and `sum` of
several arguments take all numbers of all of them.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.event_log import Condition
from tensegrity_codegen.runtime.integrate.motion import Schedule
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.simulate.condition_parts import Part, build_part
from tensegrity_codegen.runtime.simulate.condition_text import (
    FUNCTIONS,
    POSITION,
    WHERE,
    name_part,
    parse_condition,
)
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.quantities import QUANTITIES


def find_quantities(text: str) -> tuple[str, ...]:
    """Return the quantities that an expression names; raises what parse_condition raises."""
    nodes = list(ast.walk(parse_condition(text)))
    own = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    names = {node.id: None for node in nodes if isinstance(node, ast.Name) and id(node) not in own}
    return tuple(name for name in names if name in QUANTITIES and name not in (*FUNCTIONS, POSITION))


def is_comparison(text: str) -> bool:
    """Return whether an expression is a comparison: of what it stands for only the change to true counts."""
    return isinstance(parse_condition(text), ast.Compare)


@dataclass(frozen=True)
class Expression:
    """An expression over the quantities of a model, a single number.

    text: as it was written; quantities: names of the quantities that it needs.
    """

    text: str
    quantities: tuple[str, ...]
    model: CompiledModel
    whole: Part

    def evaluate(self, arguments: Mapping[str, Any], time: float = 0.0) -> float:
        """Return the value, which may be not finite.

        arguments: all run-time arguments that differ from the scene, "coordinate" among them; time: the time
        [s].
        """
        values = self._values(arguments, time)
        with np.errstate(all="ignore"):
            return float(self.whole.evaluate(values))

    def find_not_finite(self, arguments: Mapping[str, Any], time: float = 0.0) -> str:
        """Return the text of the innermost part whose value is not finite."""
        with np.errstate(all="ignore"):
            return self.whole.find_not_finite(self._values(arguments, time)).text

    def _values(self, arguments: Mapping[str, Any], time: float) -> dict[str, Any]:
        values = {name: self.model.compute(name, **arguments) for name in self.quantities}
        if self.whole.places:
            rest = {
                name: value for name, value in arguments.items() if name not in ("coordinate", "velocity")
            }
            anchors = rest.get("anchor_position")
            values[POSITION] = place_nodes(self.model, arguments["coordinate"], anchors, arguments=rest)
        return {"time": time, **values}


def build_expression(text: str, model: CompiledModel) -> Expression:
    """Return an expression over the model's quantities; raises as `build_condition`."""
    wanted = find_quantities(text)
    for name in wanted:
        if not model.has(name) or model.function(name).spec.pattern is not None:
            raise FormulationError(
                "the model has no such function for a condition",
                where=WHERE,
                given=name,
                hint="build the model with this quantity; sparse matrices cannot be part of a condition",
            )
        if "internal" in model.function(name).spec.arguments:
            raise refuse_ground(
                model.manifest.name, f"{name} in a condition", "use a quantity without friction"
            )
    whole = build_part(parse_condition(text), model.manifest)
    if whole.shape:
        raise InvalidValueError(
            "the condition is not a single number", where=WHERE, given=f"{text!r}, shape {whole.shape}",
            hint='name an entry, as in member_length["c1"] or member_length[0]',
        )  # fmt: skip
    return Expression(text, wanted, model, whole)


def build_condition(
    text: str,
    model: CompiledModel,
    arguments: Mapping[str, Any] | None = None,
    schedule: Schedule | None = None,
) -> Condition:
    """Return (time, coordinate, velocity) -> the value of an expression over the model's quantities.

    schedule: arguments that change with time.
    Raises InvalidValueError for what is no such expression or is no single number, UnknownNameError for
    unknown names, FormulationError for quantities that the model lacks. The function returned raises
    NonFiniteError where its value is not finite although coordinates and velocities are.
    """
    expression, given = build_expression(text, model), dict(arguments or {})

    def condition(time: float, coordinate: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
        state = {"coordinate": coordinate, "velocity": velocity, **given}
        state |= schedule(time) if schedule else {}
        value = expression.evaluate(state, time)
        if not np.isfinite(value) and np.isfinite(coordinate).all() and np.isfinite(velocity).all():
            raise _not_finite(text, expression.find_not_finite(state, time), time)
        return value

    return condition


def _not_finite(text: str, part: str, time: float) -> NonFiniteError:
    return NonFiniteError(
        f"the condition is not a finite number at t = {time:.6g} s",
        where=WHERE,
        given=name_part(part, text),
        allowed="a condition that is a finite number along the whole motion",
        hint="avoid division by zero and roots of negative numbers",
    )
