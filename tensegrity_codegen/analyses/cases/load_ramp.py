"""The loads that grow along a load path: added ones, those of the scene, gravity, or all of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.runtime.paths.model_path import ModelPath
    from tensegrity_codegen.scene.subject import Subject


RampKind = Literal["load", "loads", "gravity", "all"]


@dataclass(frozen=True)
class LoadRamp:
    """Loads base + load factor x pattern, by the names of the run-time arguments."""

    base: "dict[str, NDArray[np.float64]]"
    pattern: "dict[str, NDArray[np.float64]]"
    parameters: dict[str, tuple[int, ...]]

    def check_moves(self, path: "ModelPath", load_texts: Sequence[str]) -> None:
        """Raise InvalidValueError if a growing load acts on anchored axes only."""
        held = path.find_held() if load_texts else ()
        if held:
            raise InvalidValueError(
                "the load acts on anchored axes only and has no effect",
                where=f"--load {held[0]}",
                given=", ".join(held),
                allowed="a node that can move in the direction of the load",
                hint="remove these loads",
            )


def build_ramp(
    subject: "Subject", kind: RampKind | None, load: "NDArray[np.float64]", load_texts: Sequence[str]
) -> LoadRamp:
    """Return the growing and the constant loads. Raises InvalidValueError for no load.

    load (n_nodes, 3) [N]: added to the loads of the scene; load_texts: the values of --load that state it.
    kind: "load": the added loads; "loads": these and the scene's own; "gravity": gravity alone, while all
    loads stay; "all": all of them; None: the added loads, without these the scene's own, or its gravity.
    """
    import numpy as np

    axes = list(subject.axes)
    scene_load, added = subject.node_load[:, axes], load[:, axes]
    weight = np.array(subject.gravity, dtype=float)[axes]
    if kind is None:
        kind = "load" if load_texts else "loads" if scene_load.any() else "gravity" if weight.any() else "all"
    grows = {
        "load": added,
        "loads": scene_load + added,
        "gravity": 0 * scene_load,
        "all": scene_load + added,
    }[kind]
    base, pattern = {"node_load": scene_load + added - grows}, {"node_load": grows}
    parameters: dict[str, tuple[int, ...]] = {"node_load": tuple(range(subject.n_nodes))}
    if kind in ("gravity", "all") and weight.any():
        base["gravity"], pattern["gravity"], parameters["gravity"] = 0 * weight, weight, ()
    if not any(values.any() for values in pattern.values()):
        raise _no_load(kind, load_texts)
    return LoadRamp(base, pattern, parameters)


def _no_load(kind: RampKind, load_texts: Sequence[str]) -> InvalidValueError:
    if kind == "gravity":
        return InvalidValueError(
            "the scene has no gravity", where="--ramp", given=kind, allowed="a scene with the key gravity"
        )
    if kind == "load" and not load_texts:
        return InvalidValueError(
            "no load is given",
            where="--load",
            given=None,
            allowed="NODE=fx,fy,fz",
            hint="add --load, or omit --ramp load: then the scene's own loads increase",
        )
    if not load_texts:
        also = " and no gravity" if kind == "all" else ""
        return InvalidValueError(
            f"the scene has no loads{also}",
            where="--ramp",
            given=kind,
            allowed="a scene with loads that can be increased",
            hint="add --load NODE=fx,fy,fz",
        )
    return InvalidValueError(
        "the load is zero", where="--load", given=", ".join(load_texts), allowed="a force that is not zero"
    )
