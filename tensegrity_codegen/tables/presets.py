"""Named combinations of settings for the programs that use a library."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tensegrity_codegen.system.errors import check_choice


@dataclass(frozen=True)
class Preset:
    """Settings of a request, by their names in scenes, and their purpose."""

    name: str
    title: str
    settings: Mapping[str, Any] = field(default_factory=dict)


PRESETS: Mapping[str, Preset] = {
    item.name: item
    for item in (
        Preset(
            "casadi",
            "casadi.external with first and second derivatives",
            {"precision": "double", "interfaces": ("casadi_hessian",)},
        ),
        Preset(
            "acados",
            "external functions of acados, for explicit and implicit integrators",
            {"precision": "double", "interfaces": ("acados",)},
        ),
        Preset("f32", "single precision, for any processor", {"precision": "single", "interfaces": ()}),
        Preset(
            "mcu",
            "single precision, optimised for size, for microcontrollers",
            {"precision": "single", "interfaces": (), "flags": "small", "emitter": "unrolled"},
        ),
    )
}


def find_preset(name: str, where: str = "model.preset") -> Preset:
    """Return the preset of that name; raises UnknownNameError, naming `where`, for an unknown one."""
    check_choice(name, PRESETS, "preset", where)
    return PRESETS[name]
