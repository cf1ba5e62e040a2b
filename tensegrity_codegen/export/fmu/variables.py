"""The variables of a unit, in the order of their value references."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from tensegrity_codegen.export.fmu.layout import Layout, Tangent
from tensegrity_codegen.system.errors import InvalidNameError

PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
QUOTED = re.compile(r"[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]")


def join_names(quantity: str, parts: Sequence[str | int]) -> str:
    """Return the name of an entry: "member_tension.bar1"; numbers are indices from 1: "law.bar1[2]"."""
    words = [quantity, *(quote_name(part) for part in parts if isinstance(part, str))]
    numbers = [str(part + 1) for part in parts if isinstance(part, int)]
    return ".".join(words) + (f"[{','.join(numbers)}]" if numbers else "")


def quote_name(name: str) -> str:
    """Return a name as an identifier of the standard, in quotes where it is none by itself.

    Raises InvalidNameError for a name that is empty or has characters that the standard does not allow.
    """
    if PLAIN.fullmatch(name):
        return name
    letters = []
    for letter in name:
        if letter in "'\"\\":
            letters.append("\\" + letter)
        elif QUOTED.fullmatch(letter):
            letters.append(letter)
        else:
            raise InvalidNameError(
                "this name cannot be the name of a variable of an FMU",
                where="export fmu",
                given=name,
                allowed="printable ASCII characters",
            )
    if not letters:
        raise InvalidNameError("a name is empty", where="export fmu", given=name, allowed="a name")
    return f"'{''.join(letters)}'"


# Of each kind of margin: the Boolean that is true while it is negative, and its description.
KINDS = (
    ("is_slack", "Whether the cable is slack."),
    ("is_below_switch", "Whether the member is below the switch of its law."),
    ("is_lifted", "Whether the ground does not press the node."),
    ("is_sliding", "Whether the node does not stick to the ground."),
)


@dataclass(frozen=True)
class Variable:
    """One scalar variable.

    name: structured name.
    causality, variability, initial: words of the standard; initial "" where the standard has none.
    sentence: description.
    unit: unit, "1" where it has none.
    start: value at the start, where it can be set.
    type: "real", "boolean" or "integer".
    state: of a derivative: the value reference of its state.
    is_indicator: whether it is an event indicator.
    dependencies: value references of the inputs and states that it depends on; None: not known.
    least: its least value, where it has one.
    """

    name: str
    causality: str
    variability: str
    initial: str
    sentence: str
    unit: str = "1"
    start: float | None = None
    type: str = "real"
    state: int | None = None
    is_indicator: bool = False
    dependencies: tuple[int, ...] | None = None
    least: float | None = None


def list_variables(layout: Layout, tangent: Tangent | None) -> tuple[Variable, ...]:
    """Return all variables; the value reference of each is its place."""
    time = Variable("time", "independent", "continuous", "", "Time.", "s")
    return (
        time,
        *_list_arguments(layout),
        *_list_states(layout),
        *_list_derivatives(layout, tangent),
        *_list_values(layout, tangent),
        *_list_events(layout),
    )


def _list_arguments(layout: Layout) -> list[Variable]:
    found = []
    for item in layout.arguments:
        is_input = item.name == "input"
        words = ("input", "continuous", "") if is_input else ("parameter", "tunable", "exact")
        for parts, unit, start in zip(item.parts, item.units, item.spec.nominal, strict=True):
            name, least = join_names(item.name, parts), None if item.least == "any" else 0.0
            found.append(Variable(name, *words, item.spec.sentence, unit, start, least=least))
    return found


def _list_states(layout: Layout) -> list[Variable]:
    found = []
    units = layout.coordinate_units()
    for argument, suffix in (("coordinate", ""), ("velocity", "/s")):
        spec = layout.manifest.argument(argument)
        names = zip(layout.manifest.coordinate_name, units, spec.nominal, strict=True)
        for name, unit, start in names:
            words = ("local", "continuous", "exact", spec.sentence, unit + suffix)
            found.append(Variable(join_names(argument, (name,)), *words, start))
    if layout.n_internal:
        spec = layout.manifest.argument("internal")
        words = ("local", "continuous", "exact", spec.sentence, "m")
        named = zip(layout.manifest.internal_name, spec.nominal, strict=True)
        found += [Variable(join_names("internal", (name,)), *words, start) for name, start in named]
    return found


def _list_derivatives(layout: Layout, tangent: Tangent | None) -> list[Variable]:
    first, n = 1 + layout.n_arguments, layout.n_coordinates
    found = []
    for k, name in enumerate(layout.manifest.coordinate_name):
        unit = f"{layout.coordinate_units()[k]}/s"
        words = ("local", "continuous", "calculated", "Rate of the coordinate.", unit)
        found.append(
            Variable(
                f"der(coordinate.{quote_name(name)})", *words, state=first + k, dependencies=(first + n + k,)
            )
        )
    for k, name in enumerate(layout.manifest.coordinate_name):
        words = ("local", "continuous", "calculated", "Acceleration.", f"{layout.coordinate_units()[k]}/s2")
        needs = _find_dependencies(layout, tangent, k)
        found.append(
            Variable(f"der(velocity.{quote_name(name)})", *words, state=first + n + k, dependencies=needs)
        )
    for k, name in enumerate(layout.manifest.internal_name):
        words = ("local", "continuous", "calculated", "Rate of the internal state.", "m/s")
        needs = _find_dependencies(layout, tangent, n + k)
        place = first + 2 * n + k
        found.append(Variable(f"der(internal.{quote_name(name)})", *words, state=place, dependencies=needs))
    return found


def _list_values(layout: Layout, tangent: Tangent | None) -> list[Variable]:
    found, before = [], layout.n_coordinates + layout.n_internal
    for block in layout.blocks:
        causality = "output" if block.quantity in layout.outputs else "local"
        for k, parts in enumerate(block.parts):
            needs = _find_dependencies(layout, tangent, before + block.start + k)
            if block.spec is None:
                needs = _find_position_dependencies(layout, k)
            found.append(
                Variable(
                    join_names(block.quantity, parts),
                    causality,
                    "continuous",
                    "calculated",
                    block.sentence,
                    block.unit,
                    is_indicator=block.is_margin,
                    dependencies=needs,
                )
            )
    return found


def _find_dependencies(layout: Layout, tangent: Tangent | None, row: int) -> tuple[int, ...] | None:
    """Return the value references of inputs and states that a row of the derivatives depends on."""
    if tangent is None:
        return None
    parameters = range(1 + layout.n_inputs, 1 + layout.n_arguments)
    columns = (1 + column for column in tangent.pattern[row].nonzero()[0].tolist())
    return tuple(column for column in columns if column not in parameters)


def _find_position_dependencies(layout: Layout, k: int) -> tuple[int, ...]:
    node, axis = divmod(k, len(layout.manifest.axes))
    place = (node, layout.manifest.axes[axis])
    places = layout.manifest.coordinate_node_axis
    return (1 + layout.n_arguments + places.index(place),) if place in places else ()


def _list_events(layout: Layout) -> list[Variable]:
    found = [
        Variable(
            join_names(KINDS[kind][0], (name,)),
            "output",
            "discrete",
            "calculated",
            KINDS[kind][1],
            type="boolean",
        )
        for name, kind in layout.margins
    ]
    kinds = "a cable went slack or taut, or the law of a member switched"
    if layout.manifest.contact_name:
        kinds += ", or a node touched the ground, left it, stuck or slipped"
    sentence = f"Number of times that {kinds}."
    return [*found, Variable("event_count", "output", "discrete", "calculated", sentence, type="integer")]
