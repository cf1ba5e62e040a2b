"""Actuators of MJCF: constant forces as loads, forces at sites and on tendons as inputs."""

from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.formats.files.xml_file import read_numbers
from tensegrity_codegen.scene.formats.network import Network

RELATIVE_TOLERANCE = 1e-9


def read_actuators(
    root: Element, network: Network, tendons: Mapping[str, Mapping[str, Any]], file: str
) -> None:
    """Add loads and inputs to a network; what is not read is listed in a note.

    tendons: values of members by name. Actuators INPUT.TARGET of one input are one input again.
    """
    forces: dict[str, np.ndarray[Any, np.dtype[np.float64]]] = {}
    for node, force in network.loads:
        forces[node] = forces.get(node, np.zeros(3)) + force
    inputs: dict[tuple[str, str, tuple[float, ...]], dict[str, Any]] = {}
    left = []
    for number, element in enumerate(item for section in root.iterfind("actuator") for item in section):
        where = f"{file}: actuator[{number}]"
        name = element.get("name", f"actuator{number}")
        gear = read_numbers(element.get("gear", "1"), f"{where}.gear")
        pull = np.array([*gear, 0.0, 0.0, 0.0][:3])
        gain = read_numbers(element.get("gainprm", "1"), f"{where}.gainprm")[0]
        bias = read_numbers(element.get("biasprm", "0"), f"{where}.biasprm")
        constant = element.get("biastype") == "affine" and gain == 0 and not any(bias[1:])
        node, tendon = element.get("site", ""), element.get("tendon", "")
        plain = element.tag in ("general", "motor") and element.get("biastype", "none") in ("none", "affine")
        if node in network.nodes and element.get("refsite") and not any(gear[3:]) and plain:
            if constant:
                forces[node] = forces.get(node, np.zeros(3)) + bias[0] * pull
                continue
            if not any(bias) and np.any(pull):
                key = (name.partition(".")[0], "force", tuple((gain * pull).tolist()))
                entry = inputs.setdefault(key, {"kind": "force", "nodes": [], "direction": list(key[2])})
                entry["nodes"].append(node)
                continue
        stiffness = tendons.get(tendon, {}).get("spring_constant", 0.0)
        if (
            stiffness
            and plain
            and not any(bias)
            and abs(gain * gear[0] - stiffness) <= RELATIVE_TOLERANCE * stiffness
        ):
            key = (name.partition(".")[0], "rest_length", ())
            inputs.setdefault(key, {"kind": "rest_length", "members": []})["members"].append(tendon)
            continue
        left.append(name)
    weight = max((float(np.abs(force).max()) for _, force in network.loads), default=0.0)
    weights = (float(np.abs(force).max()) for force in forces.values())
    scale = max(weight, max(weights, default=0.0))
    network.loads = [
        (n, f.tolist()) for n, f in forces.items() if np.abs(f).max() > RELATIVE_TOLERANCE * scale
    ]
    for (name, _, direction), entry in inputs.items():
        network.inputs.append({"name": name, **entry})
        size = float(np.linalg.norm(direction)) if direction else 1.0
        if abs(size - 1.0) > RELATIVE_TOLERANCE:
            network.notes.append(f"the input {name} is in newtons: {size:g} times the control of the model")
    if left:
        network.notes.append(f"actuators that are not read: {', '.join(left[:10])}")
