"""The model description of a unit as XML for both versions of the standard, and the variables in it."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from tensegrity_codegen.export.fmu.layout import Layout, Tangent
from tensegrity_codegen.export.fmu.sources import Experiment
from tensegrity_codegen.system.errors import InvalidNameError
from tensegrity_codegen.system.version import VERSION

# Exponents of the units that quantities and arguments are given in.
BASE = {
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
}
FACTOR = re.compile(r"([A-Za-z]+)(\d*)")

PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
QUOTED = re.compile(r"[A-Za-z0-9_!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]")


def join_names(quantity: str, parts: Sequence[str | int]) -> str:
    """Return the name of an entry: "member_tension.bar1"; numbers are indices from 1: "law.bar1[2]"."""
    names = [quantity, *(quote_name(entry) for entry in parts if isinstance(entry, str))]
    numbers = [str(entry + 1) for entry in parts if isinstance(entry, int)]
    return ".".join(names) + (f"[{','.join(numbers)}]" if numbers else "")


def quote_name(name: str) -> str:
    """Return a name as an identifier of the standard, in quotes if it is none by itself."""
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
    """One scalar variable."""

    name: str  # structured name
    causality: str  # words of the standard; initial "" if the standard has none
    variability: str
    initial: str
    sentence: str  # description
    unit: str = "1"  # unit, "1" where it has none
    start: float | None = None  # value at the start, where it can be set
    type: str = "real"  # "real", "boolean" or "integer"
    state: int | None = None  # of a derivative: the value reference of its state
    is_indicator: bool = False  # whether it is an event indicator
    # value references of the inputs and states that it depends on; None: not known
    dependencies: tuple[int, ...] | None = None
    least: float | None = None  # its least value, where it has one


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
    variables = []
    for argument in layout.arguments:
        is_input = argument.name == "input"
        properties = ("input", "continuous", "") if is_input else ("parameter", "tunable", "exact")
        for names, unit, start in zip(argument.parts, argument.units, argument.spec.nominal, strict=True):
            name, lower = join_names(argument.name, names), None if argument.least == "any" else 0.0
            variables.append(Variable(name, *properties, argument.spec.sentence, unit, start, least=lower))
    return variables


def _list_states(layout: Layout) -> list[Variable]:
    variables = []
    units = layout.coordinate_units()
    for argument, suffix in (("coordinate", ""), ("velocity", "/s")):
        spec = layout.manifest.argument(argument)
        names = zip(layout.manifest.coordinate_name, units, spec.nominal, strict=True)
        for name, unit, start in names:
            properties = ("local", "continuous", "exact", spec.sentence, unit + suffix)
            variables.append(Variable(join_names(argument, (name,)), *properties, start))
    if layout.n_internal:
        spec = layout.manifest.argument("internal")
        properties = ("local", "continuous", "exact", spec.sentence, "m")
        named = zip(layout.manifest.internal_name, spec.nominal, strict=True)
        variables += [Variable(join_names("internal", (name,)), *properties, start) for name, start in named]
    return variables


def _list_derivatives(layout: Layout, tangent: Tangent | None) -> list[Variable]:
    start, n = 1 + layout.n_arguments, layout.n_coordinates
    computed = ("local", "continuous", "calculated")
    variables = []
    for k, name in enumerate(layout.manifest.coordinate_name):
        properties = (*computed, "Rate of the coordinate.", f"{layout.coordinate_units()[k]}/s")
        name, velocity = f"der(coordinate.{quote_name(name)})", start + n + k
        variables.append(Variable(name, *properties, state=start + k, dependencies=(velocity,)))
    for k, name in enumerate(layout.manifest.coordinate_name):
        properties = (*computed, "Acceleration.", f"{layout.coordinate_units()[k]}/s2")
        name, needs = f"der(velocity.{quote_name(name)})", _list_references(layout, tangent, k)
        variables.append(Variable(name, *properties, state=start + n + k, dependencies=needs))
    for k, name in enumerate(layout.manifest.internal_name):
        properties = (*computed, "Rate of the internal state.", "m/s")
        name, needs = f"der(internal.{quote_name(name)})", _list_references(layout, tangent, n + k)
        variables.append(Variable(name, *properties, state=start + 2 * n + k, dependencies=needs))
    return variables


def _list_values(layout: Layout, tangent: Tangent | None) -> list[Variable]:
    variables, before = [], layout.n_coordinates + layout.n_internal
    for block in layout.blocks:
        causality = "output" if block.quantity in layout.outputs else "local"
        properties = (causality, "continuous", "calculated", block.sentence, block.unit)
        for k, names in enumerate(block.parts):
            needs = _list_references(layout, tangent, before + block.start + k)
            if block.spec is None:
                needs = _list_position_references(layout, k)
            name = join_names(block.quantity, names)
            variables.append(Variable(name, *properties, is_indicator=block.is_margin, dependencies=needs))
    return variables


def _list_references(layout: Layout, tangent: Tangent | None, row: int) -> tuple[int, ...] | None:
    """Return the value references of inputs and states that a row of the derivatives depends on."""
    if tangent is None:
        return None
    parameters = range(1 + layout.n_inputs, 1 + layout.n_arguments)
    columns = (1 + column for column in tangent.pattern[row].nonzero()[0].tolist())
    return tuple(column for column in columns if column not in parameters)


def _list_position_references(layout: Layout, k: int) -> tuple[int, ...]:
    manifest = layout.manifest
    node, axis = divmod(k, len(manifest.axes))
    carriers = {point: body.corner for body in manifest.body_places for point in body.point}
    wanted = [(carrier, manifest.axes[axis]) for carrier in carriers.get(node, (node,))]
    coordinates = manifest.coordinate_node_axis
    return tuple(
        1 + layout.n_arguments + coordinates.index(entry) for entry in wanted if entry in coordinates
    )


def _list_events(layout: Layout) -> list[Variable]:
    properties = ("output", "discrete", "calculated")
    variables = [
        Variable(join_names(KINDS[kind][0], (name,)), *properties, KINDS[kind][1], type="boolean")
        for name, kind in layout.margins
    ]
    kinds = "a cable went slack or taut, or the law of a member switched"
    if layout.manifest.contact_name:
        kinds += ", or a node touched the ground, left it, stuck or slipped"
    sentence = f"Number of times that {kinds}."
    return [*variables, Variable("event_count", *properties, sentence, type="integer")]


# The model description.


def find_exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of SI base units in a unit, {} for "1".

    unit: factors apart by spaces, a power behind each, those behind a slash in the denominator: "N s/m2".
    Returns base unit -> exponent, without zeros; None if the text is no unit of this form.
    """
    if unit == "1":
        return {}
    exponents: dict[str, int] = {}
    for k, side in enumerate(unit.split("/")):
        for factor in side.split():
            match = FACTOR.fullmatch(factor)
            if match is None or match[1] not in BASE:
                return None
            power = int(match[2] or 1) * (1 if k == 0 else -1)
            for base, exponent in BASE[match[1]].items():
                exponents[base] = exponents.get(base, 0) + power * exponent
    return {base: exponent for base, exponent in exponents.items() if exponent} if unit.strip() else None


TYPES = {"2.0": {"real": "Real", "boolean": "Boolean", "integer": "Integer"}}
TYPES["3.0"] = {"real": "Float64", "boolean": "Boolean", "integer": "Int32"}
SAMPLES = 1000  # communication steps of the default experiment


@dataclass(frozen=True)
class Unit:
    """The facts of a unit in its description, besides its variables."""

    name: str
    token: str
    sources: tuple[str, ...]
    has_derivatives: bool
    experiment: Experiment


def describe_unit(unit: Unit, variables: Sequence[Variable]) -> bytes:
    """Return the text of `modelDescription.xml`."""
    is_two = unit.experiment.fmi == "2.0"
    n_indicators = sum(variable.is_indicator for variable in variables)
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": unit.experiment.fmi,
            "modelName": unit.name,
            "guid" if is_two else "instantiationToken": unit.token,
            "description": f"Tensegrity structure {unit.name}",
            "generationTool": f"tensegrity_codegen {VERSION}",
            "variableNamingConvention": "structured",
        }
        | ({"numberOfEventIndicators": str(n_indicators)} if is_two else {}),
    )
    _add_interfaces(root, unit)
    _add_units(root, variables)
    categories = SubElement(root, "LogCategories")
    for name, sentence in (
        ("logEvents", "Cables that go slack or taut"),
        ("logStatusDiscard", "Values or steps that cannot be computed"),
        ("logStatusError", "Wrong calls"),
    ):
        SubElement(categories, "Category", name=name, description=sentence)
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=repr(unit.experiment.t_end),
        tolerance=repr(unit.experiment.rtol),
        stepSize=repr(unit.experiment.t_end / SAMPLES),
    )
    _add_variables(root, unit.experiment, variables)
    (_add_structure_2 if is_two else _add_structure_3)(root, variables)
    return _write(root)


def describe_build(unit: Unit) -> bytes:
    """Return the text of `sources/buildDescription.xml` (FMI 3.0)."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=unit.name)
    files = SubElement(build, "SourceFileSet", language="C99")
    for name in unit.sources:
        SubElement(files, "SourceFile", name=name)
    return _write(root)


def _write(root: Element) -> bytes:
    indent(root)
    document: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return document + b"\n"


def _add_interfaces(root: Element, unit: Unit) -> None:
    is_two = unit.experiment.fmi == "2.0"
    state = "FMUstate" if is_two else "FMUState"
    has = str(unit.has_derivatives).lower()
    common = {
        "modelIdentifier": unit.name,
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
        "providesDirectionalDerivative" if is_two else "providesDirectionalDerivatives": has,
    } | ({} if is_two else {"providesAdjointDerivatives": has})
    for kind, tag, further in (
        ("me", "ModelExchange", {"completedIntegratorStepNotNeeded" if is_two else "": "true"}),
        ("cs", "CoSimulation", {"canHandleVariableCommunicationStepSize": "true"}),
    ):
        if kind in unit.experiment.kinds:
            attributes = {key: value for key, value in (common | further).items() if key}
            element = SubElement(root, tag, attributes)
            if is_two:
                files = SubElement(element, "SourceFiles")
                for name in unit.sources:
                    SubElement(files, "File", name=name)


def _add_units(root: Element, variables: Sequence[Variable]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({variable.unit for variable in variables}):
        exponents = find_exponents(name)
        if exponents:
            unit = SubElement(definitions, "Unit", name=name)
            SubElement(unit, "BaseUnit", {key: str(value) for key, value in exponents.items()})


def _add_variables(root: Element, experiment: Experiment, variables: Sequence[Variable]) -> None:
    listed, is_two = SubElement(root, "ModelVariables"), experiment.fmi == "2.0"
    for reference, variable in enumerate(variables):
        outer = {
            "name": variable.name,
            "valueReference": str(reference),
            "description": variable.sentence,
            "causality": variable.causality,
            "variability": variable.variability,
        } | ({"initial": variable.initial} if variable.initial else {})
        inner = {"unit": variable.unit} if find_exponents(variable.unit) else {}
        if variable.least is not None:
            inner["min"] = repr(variable.least)
        if variable.start is not None:
            inner["start"] = repr(float(variable.start))
        if variable.state is not None:
            inner["derivative"] = str(variable.state + is_two)  # an index from 1, or a value reference
        if variable.initial == "exact" and variable.causality == "local":
            inner["nominal"] = repr(experiment.length)
        tag = TYPES[experiment.fmi][variable.type]
        if is_two:
            SubElement(SubElement(listed, "ScalarVariable", outer), tag, inner)
        else:
            SubElement(listed, tag, outer | inner)


def _list_dependencies(variable: Variable, shift: int) -> dict[str, str]:
    if variable.dependencies is None:
        return {}
    return {"dependencies": " ".join(str(reference + shift) for reference in variable.dependencies)}


def _add_structure_2(root: Element, variables: Sequence[Variable]) -> None:
    """Add outputs, derivatives and the unknowns at the start, by indices from 1."""
    structure = SubElement(root, "ModelStructure")
    rows = list(enumerate(variables, start=1))
    for tag, chosen in (
        ("Outputs", [row for row in rows if row[1].causality == "output"]),
        ("Derivatives", [row for row in rows if row[1].state is not None]),
    ):
        if chosen:
            outer = SubElement(structure, tag)
            for index, variable in chosen:
                SubElement(outer, "Unknown", {"index": str(index)} | _list_dependencies(variable, 1))
    unknowns = [index for index, variable in rows if _is_first_unknown(variable)]
    if unknowns:
        outer = SubElement(structure, "InitialUnknowns")
        for index in unknowns:
            SubElement(outer, "Unknown", index=str(index))


def _add_structure_3(root: Element, variables: Sequence[Variable]) -> None:
    """Add the same by value references, and the event indicators."""
    structure = SubElement(root, "ModelStructure")
    rows = list(enumerate(variables))
    for tag, chosen in (
        ("Output", [row for row in rows if row[1].causality == "output"]),
        ("ContinuousStateDerivative", [row for row in rows if row[1].state is not None]),
        ("InitialUnknown", [row for row in rows if _is_first_unknown(row[1])]),
        ("EventIndicator", [row for row in rows if row[1].is_indicator]),
    ):
        for reference, variable in chosen:
            attributes = {} if tag == "InitialUnknown" else _list_dependencies(variable, 0)
            SubElement(structure, tag, {"valueReference": str(reference)} | attributes)


def _is_first_unknown(variable: Variable) -> bool:
    is_known = variable.causality == "output" or variable.state is not None
    return is_known and variable.initial == "calculated"
