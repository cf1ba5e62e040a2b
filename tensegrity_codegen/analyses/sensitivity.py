"""The analysis `sensitivity`: derivatives of node positions and tensions by rest lengths."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import Option, Result, ResultFile, SceneAnalysis
from tensegrity_codegen.system.errors import check_choice

if TYPE_CHECKING:
    from pathlib import Path

    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity

EQUILIBRIUM_TOLERANCE = 1e-10


@dataclass(frozen=True)
class FindSensitivity(SceneAnalysis):
    """Find the equilibrium, and differentiate positions and tensions by the rest lengths.

    Longer rest lengths are positive; pulling a cable in changes the signs. Of a structure that can slide or
    turn freely, motions are relative to the mean of its nodes.

    Example: tensegrity-codegen sensitivity prism.toml --node t1 --json
    """

    name: ClassVar[str] = "sensitivity"
    verb_order: ClassVar[int] = 140
    takes: ClassVar[tuple[str, ...]] = ("load", "input")
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile("out", (".npz",), "Write the derivatives of positions and tensions (.npz)."),
    )

    node: Annotated[tuple[str, ...], Option("list what moves this node most; may be repeated.")] = ()
    member: Annotated[
        tuple[str, ...], Option("list what changes the tension of this member most; may be repeated.")
    ] = ()
    columns: Annotated[
        tuple[str, ...],
        Option(
            "member, input or actuator whose rest lengths change; may be repeated; default: all members.",
            argument_name="by",
        ),
    ] = ()
    most: Annotated[int, Option("entries of each list.", minimum=1)] = 5

    def solve(self, case: "SceneCase") -> "SensitivityResult":
        """Return the derivatives at the equilibrium under the loads and inputs of the case."""
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.pipeline.settle import move_near_origin, with_statics
        from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
        from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
        from tensegrity_codegen.system.progress import work_pass

        subject, request, arguments = case.subject, case.request, case.arguments
        for name in self.node:
            check_choice(name, subject.node_name, "node", "--node")
        for name in self.member:
            check_choice(name, subject.member_name, "member", "--member")
        statics = with_statics(subject, request)
        loads = {"node_load": tuple(range(subject.n_nodes))} if "node_load" in arguments else {}
        quantities = find_needs("sensitivity", subject, statics).quantities
        centred, _ = move_near_origin(subject, request)
        model = case.build(centred, statics.wanting(*quantities, parameters=loads))
        start = find_equilibrium(model, arguments=arguments, tolerance=EQUILIBRIUM_TOLERANCE)
        case.warn(*start.warnings)
        with work_pass("differentiating"):
            derivatives = equilibrium_sensitivity(model, start, arguments, columns=list(self.columns) or None)
        return SensitivityResult(self, derivatives)


@dataclass(frozen=True, eq=False)
class SensitivityResult(Result):
    """Derivatives of an equilibrium by rest lengths."""

    options: FindSensitivity
    derivatives: "Sensitivity"

    @property
    def warnings(self) -> tuple[str, ...]:
        """A warning of members at their rest length."""
        names = self.derivatives.one_sided
        if not names:
            return ()
        reason = "the stiffness jumps there, and the derivatives hold on one side only"
        return (f"at rest length: {', '.join(names)}; {reason}",)

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write the derivatives."""
        write_sensitivity(self.derivatives, path, overwrite)
        return True

    def as_dict(self) -> dict[str, Any]:
        """Return the largest effect of each column, and the requested lists."""
        from tensegrity_codegen.report.result_tables import list_columns

        return {
            "status": "ok",
            **self.derivatives.as_evidence(),
            "columns": list_columns(self.derivatives),
            "nodes": {
                name: {axis: dict(row) for axis, row in rows.items()} for name, rows in self._by_node.items()
            },
            "members": {name: dict(row) for name, row in self._by_member.items()},
        }

    @property
    def _by_node(self) -> dict[str, dict[str, Any]]:
        count, rank = self.options.most, self.derivatives.rank_for_node
        return {name: {axis: rank(name, axis, count) for axis in "xyz"} for name in self.options.node}

    @property
    def _by_member(self) -> dict[str, Any]:
        count = self.options.most
        return {name: self.derivatives.rank_for_tension(name, count) for name in self.options.member}

    def describe(self) -> list[Any]:
        """Return the largest derivatives, the requested lists, and the free motions."""
        from tensegrity_codegen.report.result_tables import columns_table, list_columns, ranks_table

        derivatives, columns = self.derivatives, list_columns(self.derivatives)
        tables: list[Any] = [] if self.options.node or self.options.member else [columns_table(columns)]
        for name, rows in self._by_node.items():
            tables += [ranks_table(f"{name} along {axis}", "m/m", row) for axis, row in rows.items() if row]
        tables += [ranks_table(f"tension of {name}", "N/m", row) for name, row in self._by_member.items()]
        lines = ["rigid bars alone hold every node"]
        if math.isfinite(derivatives.smallest_eigenvalue):
            lines = [f"smallest eigenvalue of the stiffness {derivatives.smallest_eigenvalue:.6g} N/m"]
        if derivatives.gauge:
            free = ", ".join(derivatives.gauge)
            lines.append(f"free to {free}: motions are relative to the mean of the nodes")
        if derivatives.slack:
            lines.append(f"slack, and without effect: {', '.join(derivatives.slack)}")
        return [describe_largest(columns), *tables, *lines]


def describe_largest(columns: dict[str, dict[str, Any]]) -> str:
    """Return the rest length that moves a node most, and the one that changes a tension most."""
    if not columns:
        return "no rest length can change"
    moving = max(columns, key=lambda name: math.hypot(*columns[name]["motion"]))
    facts = columns[moving]
    sentence = f"{moving} moves {facts['node']} most, by {math.hypot(*facts['motion']):.3g} mm for each mm"
    changes = [
        (abs(change["derivative"]), name, change["member"])
        for name, facts in columns.items()
        for change in (facts["raised"], facts["lowered"])
        if change is not None
    ]
    if not changes:
        return sentence
    largest, name, member = max(changes)
    return f"{sentence}; {name} changes the tension of {member} most, by {largest / 1e3:.3g} N for each mm"


def write_sensitivity(sensitivity: "Sensitivity", path: "Path", overwrite: bool) -> None:
    """Write a sensitivity to an .npz file: `coordinate`, `tension`, `node`, their names, and the gauge."""
    import numpy as np

    from tensegrity_codegen.runtime.model.arrays import write_arrays

    arrays = {name: getattr(sensitivity, name) for name in ("coordinate", "tension", "node", "gauge_motion")}
    name_arrays = (
        "coordinate_name",
        "node_name",
        "member_name",
        "column_name",
        "gauge",
        "slack",
        "one_sided",
    )
    arrays |= {name: np.array(getattr(sensitivity, name), dtype=str) for name in name_arrays}
    write_arrays(path, arrays, overwrite=overwrite)


ANALYSIS = FindSensitivity
