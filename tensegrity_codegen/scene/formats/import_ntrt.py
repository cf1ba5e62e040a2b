"""Import of a structure file of the NASA Tensegrity Robotics Toolkit (NTRT, YAML).

A rod becomes a bar of mass density * pi * radius^2 * length; rods are rigid there, here a bar is `ratio`
times as stiff as the stiffest cable, or rigid on request and where there is no cable. Rods that share nodes
are one rigid body there, so here massless bracing bars join the nodes of such a body. A sphere becomes a
point mass. A cable becomes a tension-only spring of rest length length - pretension / stiffness. The
coordinates of such files are seldom in equilibrium.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, scene_name
from tensegrity_codegen.scene.formats.ntrt.load import load_structure
from tensegrity_codegen.scene.formats.ntrt.plan import Conversion, make_plan, write_document
from tensegrity_codegen.scene.formats.ntrt.structure import BuilderBook
from tensegrity_codegen.system.errors import InvalidValueError


def import_ntrt(
    path: str | Path,
    *,
    bar_stiffness_ratio: float = 1000.0,
    name: str | None = None,
    gravity: Sequence[float] | None = None,
    length_scale: float = 1.0,
    rigid: bool = False,
    pretension_scale: float = 1.0,
) -> ImportResult:
    """Return the scene document of an NTRT structure file, and notes on what was changed or left out.

    bar_stiffness_ratio: spring constant of bars over that of the stiffest cable. name: the scene's name, else
    the file's stem. gravity (3,) [m/s2]. length_scale: metres per length unit of the file; units of mass and
    time stay, so stiffness and damping keep their numbers and forces scale like lengths. rigid: rods keep
    their length exactly (formulation rigid_bar), as they always do where there is no cable. pretension_scale:
    factor on the pretension of all cables.
    """
    scales = {
        "bar_stiffness_ratio": bar_stiffness_ratio,
        "length_scale": length_scale,
        "pretension_scale": pretension_scale,
    }
    for key, value in scales.items():
        if not (math.isfinite(value) and value > 0):
            raise InvalidValueError("the value is out of range", where=key, given=value, allowed="above 0")
    path = Path(path)
    title, notes = scene_name(name, path, "scene_")
    builders = BuilderBook()
    structure = load_structure(path, builders)
    plan = make_plan(structure, builders, str(path))
    document: dict[str, Any] = {"name": title}
    if gravity is not None:
        document["gravity"] = [float(value) for value in gravity]
    document |= write_document(
        structure, plan, Conversion(bar_stiffness_ratio, length_scale, rigid, pretension_scale)
    )
    if pretension_scale != 1:
        plan.notes.append(f"pretensions are scaled by {pretension_scale:g}")
    plan.notes += _note_up(gravity)
    if length_scale != 1:
        plan.notes.append(f"lengths are scaled by {length_scale:g}; units of mass and time are the file's")
    return ImportResult(document, (*notes, *plan.notes))


def _note_up(gravity: Sequence[float] | None) -> list[str]:
    """Return a note if gravity does not act along y, which is up in the toolkit's files."""
    if gravity is None or not any(gravity) or max(range(3), key=lambda axis: abs(gravity[axis])) == 1:
        return []
    strength = math.hypot(*gravity)
    return [
        "y is up in the toolkit's files, and gravity does not act along y: the structure lies on its side; "
        f"try `gravity=0,{-strength:g},0`, or `up=y` to turn it upright"
    ]


FORMAT = Format(
    title="structure files of the NASA Tensegrity Robotics Toolkit (NTRT, YAML)", sources=("structure.yaml",),
    endings=(".yaml", ".yml"), read=import_ntrt, options=("bar_stiffness_ratio", "rigid", "pretension_scale"),
    order=2,
)  # fmt: skip
