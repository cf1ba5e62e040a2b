"""A scene with the values of inputs, loads and the compiler that one command states."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, BuiltLibrary, build_library
from tensegrity_codegen.pipeline.settle import with_statics
from tensegrity_codegen.structure.bodies import BodySystem

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True, eq=False)
class SceneCase:
    """The scene of an analysis, with the options that all analyses share.

    inputs: values of inputs by name, if they differ from the scene.
    load (n_nodes, 3) [N]: added to the loads of the scene; load_texts: the values of `--load`.
    warn: called with warnings, a sentence each.
    command: the text of the command, for pages that quote it.
    whole: whether tables are printed with all their rows.
    files: paths of the files to write, by their options.
    name_options: replaces names of arguments of Python in texts by those of options.
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

    def build_statics(self, structure: "Subject") -> "CompiledModel":
        """Return the library for the search for equilibria, with all loads as arguments."""
        loads = {"node_load": tuple(range(structure.n_nodes))}
        statics = replace(with_statics(structure, self.request), parameters=loads)
        return self.build(structure, find_needs("equilibrium", structure, statics).alone(statics))

    def settle(self, model: "CompiledModel") -> "Equilibrium":
        """Return the equilibrium of the scene, accurate enough for its vibrations, after its warnings.

        Warnings say, for example, that the structure snapped on the way to it.
        """
        from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium
        from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance

        # Residual forces would turn neutral motions into slow ones.
        tolerance = choose_tolerance(self.subject)
        equilibrium = find_equilibrium(model, arguments=self.arguments, tolerance=tolerance)
        self.warn(*equilibrium.warnings)
        return equilibrium

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
        """Inputs, and loads if some are added, as arguments of a library."""
        loads = {"node_load": self.node_load} if self.added_load.any() else {}
        return {**self.inputs, **loads}

    @property
    def held_load(self) -> list[str]:
        """Parts "NODE.axis" of the added loads that go straight into a support."""
        if isinstance(self.subject, BodySystem):
            return []
        indices = np.argwhere((self.added_load != 0.0) & self.subject.node_anchored)
        return [f"{self.subject.node_name[node]}.{'xyz'[axis]}" for node, axis in indices]

    def warn_held_load(self, names: Sequence[str]) -> None:
        """Warn that added loads act on supports alone, if any do: at these nodes or parts "NODE.axis"."""
        if names:
            sentence = "supports take a part of the load at once, which counts in reactions alone"
            self.warn(f"{sentence}: {', '.join(names)}")
