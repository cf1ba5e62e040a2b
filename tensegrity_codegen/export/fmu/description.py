"""The model description of a unit as XML, for both versions of the standard."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from tensegrity_codegen.export.fmu.sources import Experiment
from tensegrity_codegen.export.fmu.variables import Variable
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


def find_exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of SI base units in a unit, {} for "1".

    unit: factors apart by spaces, a power behind each, those behind a slash in the denominator: "N s/m2".
    Returns base unit -> exponent, without zeros; None where the text is no unit of this form.
    """
    if unit == "1":
        return {}
    found: dict[str, int] = {}
    for k, part in enumerate(unit.split("/")):
        for word in part.split():
            match = FACTOR.fullmatch(word)
            if match is None or match[1] not in BASE:
                return None
            power = int(match[2] or 1) * (1 if k == 0 else -1)
            for base, exponent in BASE[match[1]].items():
                found[base] = found.get(base, 0) + power * exponent
    return {base: exponent for base, exponent in found.items() if exponent} if unit.strip() else None


TYPES = {"2.0": {"real": "Real", "boolean": "Boolean", "integer": "Integer"}}
TYPES["3.0"] = {"real": "Float64", "boolean": "Boolean", "integer": "Int32"}
SAMPLES = 1000  # communication steps of the default experiment


@dataclass(frozen=True)
class Unit:
    """What the description says of a unit besides its variables."""

    name: str
    token: str
    sources: tuple[str, ...]
    has_derivatives: bool
    experiment: Experiment


def describe_unit(unit: Unit, variables: Sequence[Variable]) -> bytes:
    """Return the text of `modelDescription.xml`."""
    is_two = unit.experiment.fmi == "2.0"
    n_indicators = sum(item.is_indicator for item in variables)
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
    text: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


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
    for kind, word, more in (
        ("me", "ModelExchange", {"completedIntegratorStepNotNeeded" if is_two else "": "true"}),
        ("cs", "CoSimulation", {"canHandleVariableCommunicationStepSize": "true"}),
    ):
        if kind in unit.experiment.kinds:
            attributes = {key: value for key, value in (common | more).items() if key}
            element = SubElement(root, word, attributes)
            if is_two:
                files = SubElement(element, "SourceFiles")
                for name in unit.sources:
                    SubElement(files, "File", name=name)


def _add_units(root: Element, variables: Sequence[Variable]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({item.unit for item in variables}):
        exponents = find_exponents(name)
        if exponents:
            unit = SubElement(definitions, "Unit", name=name)
            SubElement(unit, "BaseUnit", {key: str(value) for key, value in exponents.items()})


def _add_variables(root: Element, experiment: Experiment, variables: Sequence[Variable]) -> None:
    listed, is_two = SubElement(root, "ModelVariables"), experiment.fmi == "2.0"
    for reference, item in enumerate(variables):
        outer = {
            "name": item.name,
            "valueReference": str(reference),
            "description": item.sentence,
            "causality": item.causality,
            "variability": item.variability,
        } | ({"initial": item.initial} if item.initial else {})
        inner = {"unit": item.unit} if find_exponents(item.unit) else {}
        if item.least is not None:
            inner["min"] = repr(item.least)
        if item.start is not None:
            inner["start"] = repr(float(item.start))
        if item.state is not None:
            inner["derivative"] = str(item.state + is_two)  # an index from 1, or a value reference
        if item.initial == "exact" and item.causality == "local":
            inner["nominal"] = repr(experiment.length)
        word = TYPES[experiment.fmi][item.type]
        if is_two:
            SubElement(SubElement(listed, "ScalarVariable", outer), word, inner)
        else:
            SubElement(listed, word, outer | inner)


def _list_dependencies(item: Variable, shift: int) -> dict[str, str]:
    if item.dependencies is None:
        return {}
    return {"dependencies": " ".join(str(reference + shift) for reference in item.dependencies)}


def _add_structure_2(root: Element, variables: Sequence[Variable]) -> None:
    """Add outputs, derivatives and what is computed at the start, by indices from 1."""
    structure = SubElement(root, "ModelStructure")
    rows = list(enumerate(variables, start=1))
    for word, chosen in (
        ("Outputs", [row for row in rows if row[1].causality == "output"]),
        ("Derivatives", [row for row in rows if row[1].state is not None]),
    ):
        if chosen:
            outer = SubElement(structure, word)
            for index, item in chosen:
                SubElement(outer, "Unknown", {"index": str(index)} | _list_dependencies(item, 1))
    first = [index for index, item in rows if _is_first_unknown(item)]
    if first:
        outer = SubElement(structure, "InitialUnknowns")
        for index in first:
            SubElement(outer, "Unknown", index=str(index))


def _add_structure_3(root: Element, variables: Sequence[Variable]) -> None:
    """Add the same by value references, and the event indicators."""
    structure = SubElement(root, "ModelStructure")
    rows = list(enumerate(variables))
    for reference, item in rows:
        if item.causality == "output":
            attributes = {"valueReference": str(reference)} | _list_dependencies(item, 0)
            SubElement(structure, "Output", attributes)
    for reference, item in rows:
        if item.state is not None:
            attributes = {"valueReference": str(reference)} | _list_dependencies(item, 0)
            SubElement(structure, "ContinuousStateDerivative", attributes)
    for reference, item in rows:
        if _is_first_unknown(item):
            SubElement(structure, "InitialUnknown", valueReference=str(reference))
    for reference, item in rows:
        if item.is_indicator:
            attributes = {"valueReference": str(reference)} | _list_dependencies(item, 0)
            SubElement(structure, "EventIndicator", attributes)


def _is_first_unknown(item: Variable) -> bool:
    is_known = item.causality == "output" or item.state is not None
    return is_known and item.initial == "calculated"
