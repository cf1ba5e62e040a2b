"""The analysis `linearize`: the linear model of a scene or of many cases, its frequencies and damping."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from tensegrity_codegen.analyses.cases.at_point import AtPoint, Point, ResultColumn
from tensegrity_codegen.analyses.cases.record import COORDINATE, Output, Result, ResultFile

if TYPE_CHECKING:
    from pathlib import Path

    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.linear.linearize import LinearModel
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.tables.manifest import Manifest

DEFAULT_RESULTS = ("natural_frequency", "damping_ratio", "A", "B")
# Results of each linear model: axes, type, unit, sentence.
RESULTS: Mapping[str, ResultColumn] = {
    "natural_frequency": (("mode",), "float64", "Hz", "Undamped natural frequencies."),
    "damping_ratio": (("mode",), "float64", "1", "Damping ratios of these modes."),
    "A": (("state", "state_column"), "float64", "", "Jacobian dx'/dx."),
    "B": (("state", "input"), "float64", "", "Jacobian dx'/du."),
    "residual_rate": (("state",), "float64", "", "State derivative at the point."),
    "zero_eigenvalues": ((), "int64", "1", "Eigenvalues that are zero to rounding."),
    "growing_eigenvalues": ((), "int64", "1", "Eigenvalues with a positive real part."),
    "is_balanced": ((), "int64", "1", "1 where forces are in balance at the point."),
    "one_sided_cables": ((), "int64", "1", "Cables exactly at rest length, where the stiffness jumps."),
}


@dataclass(frozen=True)
class Linearize(AtPoint):
    """Linearize the equations of motion: x' = A (x - x0) + B (u - u0) + r, exact sparse derivatives.

    r is the state derivative at (x0, u0): zero at an equilibrium, up to its tolerance. The file has x0, u0
    and r as `state`, `input` and `residual_rate`; its `c` belongs to the same model as x' = A x + B u + c.
    In .npz files matrices are rows, columns and values, in .mat files sparse; .csv files have the columns
    matrix, row, column, value, with names of states and inputs.

    Example: tensegrity-codegen linearize prism.toml --settle --json
    """

    name: ClassVar[str] = "linearize"
    success_phrase: ClassVar[str] = "were linearized"
    verb_order: ClassVar[int] = 220
    takes: ClassVar[tuple[str, ...]] = ("input",)
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile("out", (".npz", ".mat", ".csv"), "Write A, B, vectors and names (.npz, .mat or .csv)."),
    )
    analysis: ClassVar[str] = "linearize"
    results: ClassVar[Mapping[str, ResultColumn]] = RESULTS
    default_results: ClassVar[tuple[str, ...]] = DEFAULT_RESULTS

    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return descriptions of the stored arrays; without inputs B only if `keep` names it."""
        outputs = super().outputs(manifest)
        return tuple(
            output for output in outputs if manifest.input_name or output.name != "B" or "B" in self.keep
        )

    def compute_case(
        self,
        model: "CompiledModel",
        point: Point,
        arguments: Mapping[str, Any],
        names: Collection[str],
    ) -> Mapping[str, Any]:
        """Return the results `names` of one case."""
        from tensegrity_codegen.runtime.linear.linearize import linearize

        coordinate, velocity = point
        settled, start = (coordinate, None) if self.about == "equilibrium" else (None, coordinate)
        linear = linearize(model, settled, coordinate=start, velocity=velocity, arguments=arguments)
        return {name: _read(linear, name) for name in names}

    def solve(self, case: "SceneCase") -> "LinearResult":
        """Return the linear model of a scene about its own state or the equilibrium."""
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.pipeline.settle import (
            has_statics,
            is_corrected,
            settle_structure,
            with_statics,
        )
        from tensegrity_codegen.runtime.linear.linearize import linearize
        from tensegrity_codegen.structure.structure import Structure
        from tensegrity_codegen.system.progress import work_pass

        structure, request = case.subject, case.request
        if isinstance(structure, Structure) and is_corrected(request):
            request = with_statics(structure, request)  # springs are exact, and cost nothing here if stiff
        searches = self.settles
        if self.settles and isinstance(structure, Structure) and not has_statics(request):
            # The equilibrium is found in node positions, the linear model in the coordinates of the scene.
            structure = settle_structure(
                structure, request, compiler=case.compiler, warn=case.warn, arguments=case.inputs
            )
            structure, searches = structure.with_changes(node_velocity=0 * structure.node_velocity), False
        needs = find_needs("linearize", structure, request).alone(request)
        if searches:
            needs = find_needs("equilibrium", structure, request).besides(needs)
        model = case.build(structure, needs)
        about: Any = model.nominal(COORDINATE) if self.settles else None
        if searches:
            about = case.settle(model)
        with work_pass("linearizing"):
            return LinearResult(linearize(model, about, arguments=case.inputs))


@dataclass(frozen=True, eq=False)
class LinearResult(Result):
    """The linear model of a scene."""

    linear: "LinearModel"

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the linear model."""
        return tuple(self.linear.warnings)

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write matrices, vectors and names."""
        self.linear.write(path, overwrite=overwrite)
        return True

    def as_dict(self) -> dict[str, Any]:
        """Return frequencies, eigenvalues and sizes."""
        return {"status": "ok", **self.linear.as_evidence()}

    def describe(self) -> list[Any]:
        """Return modes, spectrum and the largest state derivative at the point."""
        from tensegrity_codegen.report.result_tables import modes_table, say_finding, say_spectrum

        linear, facts = self.linear, self.linear.as_evidence()
        return [
            say_finding(linear.natural_frequency, linear.spectrum),
            f"{facts['n_states']} states, {facts['n_inputs']} inputs; A has {linear.A.nnz} non-zeros, "
            f"B {linear.B.nnz}",
            modes_table(linear.natural_frequency, linear.damping_ratio),
            *say_spectrum(linear.spectrum),
            "x' = A (x - x0) + B (u - u0) + r; largest entry of r, the state derivative at x0: "
            f"{facts['largest_residual_rate']:.3g}",
        ]


def _read(linear: "LinearModel", name: str) -> Any:
    """Return one result of a linear model."""
    if name in ("A", "B"):
        return getattr(linear, name).toarray()
    value = linear.as_evidence()[name]
    return len(value) if name == "one_sided_cables" else value


ANALYSIS = Linearize
