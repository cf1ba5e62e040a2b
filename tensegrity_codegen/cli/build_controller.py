"""The option `--build` of `control`: the controller in C, written where feedback holds."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.output import Output

if TYPE_CHECKING:
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.runtime.model.model import CompiledModel


def check_build(folder: Path | None, precision: str, scene: Path, overwrite: bool) -> None:
    """Raise OutputError for a folder that cannot be written, UnknownNameError for a precision."""
    from tensegrity_codegen.system.output_folder import check_folder
    from tensegrity_codegen.tables.precision import find_precision

    find_precision(precision, "precision")
    if folder is not None:
        check_folder(folder, inputs=[scene], overwrite=overwrite)


def write_controller(
    output: Output,
    study: "ControlStudy",
    model: "CompiledModel",
    folder: Path | None,
    *,
    scene: Path,
    precision: str,
    compiler: str | None,
    overwrite: bool,
) -> dict[str, Any] | None:
    """Write the controller of a study that holds; return folder, files and sizes, JSON-ready."""
    from tensegrity_codegen.control.embedded.build_controller import build_controller

    if folder is None:
        return None
    if not study.holds:
        output.warn("the controller in C is not written, for feedback does not hold")
        return None
    bundle = build_controller(
        model, study.motion, study.gains, estimator=study.estimator, distribution=study.distribution,
        out=folder, precision=precision, compiler=compiler, overwrite=overwrite, inputs=[scene],
    )  # fmt: skip
    made = bundle.description
    return {
        "folder": str(bundle.folder),
        "files": list(bundle.files),
        "name": made.name,
        "precision": made.precision,
        "gain_knots": len(study.gains.time),
        "table_bytes": made.table_bytes,
        "library": made.library,
    }
