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

    def check_moves(self, path: "ModelPath", words: Sequence[str]) -> None:
        """Raise InvalidValueError where a growing load acts on what is held only."""
        held = path.find_held() if words else ()
        if held:
            raise InvalidValueError(
                "the load acts on anchored axes only and has no effect",
                where=f"--load {held[0]}",
                given=", ".join(held),
                allowed="a node that can move in the direction of the load",
                hint="remove these loads",
            )


def build_ramp(
    subject: "Subject", kind: RampKind | None, load: "NDArray[np.float64]", words: Sequence[str]
) -> LoadRamp:
    """Return what grows and what stays. Raises InvalidValueError for no load.

    load (n_nodes, 3) [N]: added to the loads of the scene; words: the values of --load that state it.
    kind: "load": the added loads; "loads": these and the scene's own; "gravity": gravity alone, while all
    loads stay; "all": all of them; None: the added loads, without these the scene's own, or its gravity.
    """
    import numpy as np

    axes = list(subject.axes)
    own, added = subject.node_load[:, axes], load[:, axes]
    weight = np.array(subject.gravity, dtype=float)[axes]
    if kind is None:
        kind = "load" if words else "loads" if own.any() else "gravity" if weight.any() else "all"
    grows = {"load": added, "loads": own + added, "gravity": 0 * own, "all": own + added}[kind]
    base, pattern = {"node_load": own + added - grows}, {"node_load": grows}
    parameters: dict[str, tuple[int, ...]] = {"node_load": tuple(range(subject.n_nodes))}
    if kind in ("gravity", "all") and weight.any():
        base["gravity"], pattern["gravity"], parameters["gravity"] = 0 * weight, weight, ()
    if not any(values.any() for values in pattern.values()):
        raise _no_load(kind, words)
    return LoadRamp(base, pattern, parameters)


def _no_load(kind: RampKind, words: Sequence[str]) -> InvalidValueError:
    if kind == "gravity":
        return InvalidValueError(
            "the scene has no gravity", where="--ramp", given=kind, allowed="a scene with the key gravity"
        )
    if kind == "load" and not words:
        return InvalidValueError(
            "no load is given",
            where="--load",
            given=None,
            allowed="NODE=fx,fy,fz",
            hint="add --load, or omit --ramp load: then the scene's own loads increase",
        )
    if not words:
        also = " and no gravity" if kind == "all" else ""
        return InvalidValueError(
            f"the scene has no loads{also}",
            where="--ramp",
            given=kind,
            allowed="a scene with loads that can be increased",
            hint="add --load NODE=fx,fy,fz",
        )
    return InvalidValueError(
        "the load is zero", where="--load", given=", ".join(words), allowed="a force that is not zero"
    )
