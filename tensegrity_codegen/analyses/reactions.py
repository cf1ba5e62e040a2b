"""The analysis `reactions`: forces of the supports in the equilibrium of a scene or of many cases."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Option, Output, ResultFile, SceneAnalysis
from tensegrity_codegen.analyses.equilibrium import SearchResult
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.static_methods import Method

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.pipeline.analyses import Needs
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.tables.manifest import Manifest
    from tensegrity_codegen.tables.request import ModelRequest

RESULTS = {
    "reaction": "Forces of the supports on the nodes, along anchored axes; 0 at free nodes.",
    "total": "Sum of these forces.",
}
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class FindReactions(SceneAnalysis, CaseAnalysis):
    """Find the forces of the supports on a structure in its stable equilibrium, and their sum.

    A support acts along the anchored axes of its node. The sum balances weights, loads and forces of inputs.
    Forces of feet on the ground are those of `equilibrium` and `stand`. Exit code 3 if no equilibrium is
    found.

    Example: tensegrity-codegen reactions two_nodes.toml --load n2=0,0,-10
    """

    name: ClassVar[str] = "reactions"
    success_phrase: ClassVar[str] = "converged"
    verb_order: ClassVar[int] = 117
    takes: ClassVar[tuple[str, ...]] = ("load", "input")
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile("out", (".csv",), "Write node, x, y, z [N] of each support as a table (.csv)."),
    )

    tolerance: Annotated[float, Option("largest node residual, part of the largest member force.")] = 1e-9
    method: Annotated[Method, Option("method: auto, newton or relaxation.")] = "auto"

    @property
    def analyses(self) -> tuple[str, ...]:
        """Names of the functions that the library must serve, as in `compile_scene(for_=...)`."""
        return ("equilibria",)

    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return the functions of the search for equilibria."""
        from tensegrity_codegen.pipeline.analyses import find_needs

        self._list_kept()
        _require_supports(structure)
        return find_needs("equilibria", structure, request)

    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return the forces of all nodes, and their sum."""
        nodes: dict[str, tuple[Any, ...]] = {"node": manifest.node_name, "axis": AXES}
        arrays = {
            "reaction": (("node", "axis"), (len(manifest.node_name), 3), nodes),
            "total": (("axis",), (3,), {"axis": AXES}),
        }
        return tuple(
            Output(name, dims, shape, "float64", "N", RESULTS[name], labels)
            for name, (dims, shape, labels) in arrays.items()
            if name in self._list_kept()
        )

    def _list_kept(self) -> tuple[str, ...]:
        self.check_keep(RESULTS)
        return self.keep or tuple(RESULTS)

    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Find the equilibria, and the reactions of those that are found."""
        import numpy as np

        from tensegrity_codegen.analyses.cases.case_equilibria import find_case_equilibria

        equilibria = find_case_equilibria(model, case_arguments, threads, **self.options)
        outcomes.mark_ok(equilibria.status, equilibria.message)
        reaction = np.full((case_arguments.count, len(model.manifest.node_name), 3), np.nan)
        for k in np.flatnonzero(equilibria.is_found).tolist():
            position, tension = equilibria.node_position[k], equilibria.member_tension[k]
            reaction[k] = compute_node_reactions(model, position, tension, case_arguments.select_case(k))
        arrays = {"reaction": reaction, "total": reaction.sum(axis=1)}
        return {name: arrays[name] for name in self._list_kept()}

    def solve(self, case: "SceneCase") -> "ReactionsResult":
        """Return the reactions of a scene."""
        from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

        structure = _require_supports(case.subject)
        model = case.build_statics(structure)
        equilibrium = find_equilibrium(
            model,
            arguments=case.arguments,
            tolerance=self.tolerance,
            method=self.method,
            raise_on_failure=False,
        )
        position, tension = equilibrium.node_position, equilibrium.member_tension
        arguments = {**case.inputs, "node_load": case.node_load}
        reaction = compute_node_reactions(model, position, tension, arguments)
        return ReactionsResult(equilibrium, structure, reaction)


@dataclass(frozen=True, eq=False)
class ReactionsResult(SearchResult):
    """Reactions (n_nodes, 3) [N] of a scene in its equilibrium."""

    structure: "Structure"
    reaction: "NDArray[np.float64]"

    @property
    def supports(self) -> "dict[str, NDArray[np.float64]]":
        """Forces (3,) [N] of the supports by node; none if no equilibrium was found."""
        nodes = set(self.structure.node_anchored.nonzero()[0].tolist()) if self.is_good else set()
        return {self.structure.node_name[node]: self.reaction[node] for node in sorted(nodes)}

    def as_dict(self) -> dict[str, Any]:
        """Return forces by node, their sum, and the search for the equilibrium."""
        return {
            "status": self.equilibrium.status,
            "message": self.equilibrium.message,
            "residual": self.equilibrium.residual,
            "reaction": {name: force.tolist() for name, force in self.supports.items()},
            "total": self.reaction.sum(axis=0).tolist() if self.is_good else None,
        }

    def describe(self) -> list[Any]:
        """Return the sum, and a table of the supports."""
        from tensegrity_codegen.report.tables import feet_table

        if not self.is_good:
            return [f"{self.equilibrium.status}: {self.equilibrium.message}"]
        total = ", ".join(f"{force:.6g}" for force in self.reaction.sum(axis=0))
        names = tuple(self.supports)
        rows = [self.structure.node_name.index(name) for name in names]
        table = feet_table(self.structure.name, names, self.reaction[rows])
        table = replace(table, title=f"{self.structure.name}: supports", things="supports")
        return [f"{self.equilibrium.status}: supports carry {total} N along x, y, z together", table]

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write the table of the supports, if an equilibrium was found."""
        from tensegrity_codegen.system.files import write_text

        rows = [f"{node},{','.join(map(repr, force.tolist()))}" for node, force in self.supports.items()]
        if self.is_good:
            write_text("\n".join(["node,x,y,z", *rows]) + "\n", path, overwrite=overwrite)
        return self.is_good


def compute_node_reactions(
    model: "CompiledModel",
    position: "NDArray[np.float64]",
    tension: "NDArray[np.float64]",
    arguments: Mapping[str, Any],
) -> "NDArray[np.float64]":
    """Return the forces (n_nodes, 3) [N] of supports on nodes at rest, 0 along free axes.

    position (n_nodes, 3) [m]; tension (n_members,) [N]; arguments: loads, masses, gravity and inputs, if
    they differ from the scene.
    """
    import numpy as np

    from tensegrity_codegen.report.loads import compute_reactions
    from tensegrity_codegen.runtime.model.arguments import INPUT, merge_inputs
    from tensegrity_codegen.structure.applied_inputs import find_input_force

    structure, manifest = _require_supports(model.structure), model.manifest
    axes, values = list(manifest.axes), merge_inputs(manifest, arguments)
    changed = {name: np.array(getattr(structure, name)) for name in ("node_load", "node_mass", "gravity")}
    for argument in manifest.arguments:
        if argument.name in changed and argument.name in values:
            nodes = [manifest.node_name.index(name) for name in argument.over]
            index = np.ix_(nodes, axes) if argument.name == "node_load" else nodes or axes
            changed[argument.name][index] = values[argument.name]
    pushed = dict(zip(manifest.input_name, np.ravel(values.get(INPUT, ())), strict=False))
    moved = structure.with_changes(gravity=changed["gravity"], node_mass=changed["node_mass"])
    load = changed["node_load"] + find_input_force(structure, pushed)
    held = np.arange(structure.n_nodes)
    reaction: NDArray[np.float64] = compute_reactions(moved, position[None], tension[None], held, load[None])[
        0
    ]
    return reaction


def _require_supports(subject: "Subject | None") -> "Structure":
    """Return the structure; FormulationError for a scene of bodies, or one without anchors."""
    from tensegrity_codegen.structure.structure import Structure

    if not isinstance(subject, Structure):
        raise FormulationError("reactions are of nodes, not of points of bodies", where="bodies")
    if not subject.node_anchored.any():
        raise FormulationError(
            "no node is anchored, so that there are no supports",
            where="nodes",
            allowed="a scene with anchored = true at some nodes",
            hint="forces of feet on the ground are in `equilibrium` and `stand`",
        )
    return subject


ANALYSIS = FindReactions
