"""A scene with what one question adds to it: values of inputs, loads, and the compiler of its libraries."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.build_library import FEW_CALLS, BuiltLibrary, build_library
from tensegrity_codegen.structure.bodies import BodySystem

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True, eq=False)
class SceneCase:
    """One case of an analysis, from its scene.

    inputs: values of inputs by name, where they differ from the scene.
    load (n_nodes, 3) [N]: added to the loads of the scene; load_texts: how the command states it.
    warn: called with sentences about what may be unexpected.
    command: the command that asks, for pages that name it.
    whole: whether tables are printed with all their rows.
    files: paths of the files that are asked for, by their options.
    name_options: returns texts with arguments of Python named as the door that asks names them.
    """

    subject: "Subject"
    request: "ModelRequest"
    inputs: Mapping[str, float] = field(default_factory=dict)
    load: NDArray[np.float64] | None = None
    compiler: str | None = None
    warn: Callable[..., None] = lambda *texts: None
    command: str = ""
    load_texts: tuple[str, ...] = ()
    whole: bool = False
    flags: str | None = None
    files: Mapping[str, Any] = field(default_factory=dict)
    name_options: Callable[[Any], Any] = lambda value: value

    def build(self, subject: "Subject", request: "ModelRequest") -> "CompiledModel":
        """Return the library for a few evaluations; raises as `build_library`."""
        return self.build_library(subject, request, FEW_CALLS).load()

    def build_library(self, subject: "Subject", request: "ModelRequest", calls: int) -> BuiltLibrary:
        """Return the library for a number of evaluations; raises as `build_library`."""
        return build_library(subject, request, compiler=self.compiler, flags=self.flags, calls=calls)

    def settle(self, model: "CompiledModel") -> "Equilibrium":
        """Return the equilibrium about which an analysis is done, as exact as vibrations need it.

        What is unexpected in it, such as that the structure snapped on the way there, is a warning.
        """
        from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium
        from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance

        # What is left of the forces turns neutral motions into slow ones.
        tolerance = choose_tolerance(self.subject)
        found = find_equilibrium(model, arguments=self.arguments, tolerance=tolerance)
        self.warn(*found.warnings)
        return found

    @cached_property
    def added_load(self) -> NDArray[np.float64]:
        """Loads added, (n_nodes, 3) [N]."""
        return np.zeros((self.subject.n_nodes, 3)) if self.load is None else self.load

    @property
    def node_load(self) -> NDArray[np.float64]:
        """All loads as the run-time parameter of this name, (n_nodes, n_axes) [N]."""
        total: NDArray[np.float64] = self.subject.node_load + self.added_load
        return total[:, list(self.subject.axes)]

    @property
    def arguments(self) -> dict[str, Any]:
        """Inputs, and loads where some are added, as arguments of a library."""
        loads = {"node_load": self.node_load} if self.added_load.any() else {}
        return {**self.inputs, **loads}

    @property
    def held_load(self) -> list[str]:
        """Parts "NODE.axis" of the added loads that go straight into a support."""
        if isinstance(self.subject, BodySystem):
            return []
        places = np.argwhere((self.added_load != 0.0) & self.subject.node_anchored)
        return [f"{self.subject.node_name[node]}.{'xyz'[axis]}" for node, axis in places]
