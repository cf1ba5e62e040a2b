"""The libraries of the groups of cases in one process: built or found in the cache, and loaded once."""

from dataclasses import dataclass, field

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.sweeps.apply.group import CaseGroup
from tensegrity_codegen.sweeps.engines.work import library_request
from tensegrity_codegen.sweeps.tasks.operation import Operation


@dataclass(eq=False)
class Libraries:
    """Libraries by the number of their group.

    Attributes
    ----------
    operation : Operation
        What the libraries are for.
    models : dict of int to CompiledModel
        Those that are loaded; a forked process has them too.
    """

    operation: Operation
    models: dict[int, CompiledModel] = field(default_factory=dict)

    def load(self, group: CaseGroup) -> CompiledModel:
        """Return the library of a group; raises as `build_library`."""
        if group.number not in self.models:
            built = build_library(group.structure, library_request(group, self.operation))
            self.models[group.number] = built.load()
        return self.models[group.number]

    def __getstate__(self) -> dict[str, object]:
        """Return what a process that starts anew gets: it loads the libraries itself."""
        return {"operation": self.operation, "models": {}}
