"""Write a controller in C: feedback about a motion, its estimator and the model that it needs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.control.embedded.loaded import (
    ControllerDescription,
    LoadedController,
    load_controller,
)
from tensegrity_codegen.control.embedded.parts import (
    MOVED_TO_CODE,
    ControllerCode,
    check_alone,
    collect_parts,
    collect_policy,
    find_model_and_request,
    find_motion,
    read_code,
)
from tensegrity_codegen.control.embedded.write import write_files
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import MOVED_TO_LIMITS, ActuatorLimits
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.control.feedback.policy import Policy
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.scene.names import check_scene_name
from tensegrity_codegen.system.checks import check_path, check_switch, with_moved
from tensegrity_codegen.system.output_folder import check_folder, write_folder
from tensegrity_codegen.tables.precision import find_precision


@dataclass(frozen=True)
class ControllerBundle:
    """A controller in C, as written into a folder.

    Attributes
    ----------
    folder : Path
        Where the files are.
    files : tuple of str
        Names of the files.
    description : ControllerDescription
        Names, sizes, knots, precision; also in ``manifest.json``.
    """

    folder: Path
    files: tuple[str, ...]
    description: ControllerDescription

    def load(self) -> LoadedController:
        """Load the compiled controller into this process, as `load_controller` does."""
        return load_controller(self.folder)


@with_moved(**MOVED_TO_CODE, **MOVED_TO_LIMITS)
def build_controller(
    scene: str | Path | CompiledModel,
    motion: Motion | Equilibrium | None = None,
    gains: Gains | Mpc | None = None,
    *,
    estimator: Estimator | None = None,
    distribution: TensionDistribution | None = None,
    policy: Policy | None = None,
    out: str | Path,
    sample: float | None = None,
    limits: ActuatorLimits | None = None,
    arguments: Mapping[str, Any] | None = None,
    code: ControllerCode | None = None,
    overwrite: bool = False,
) -> ControllerBundle:
    """Write a controller in C into a folder: all of its files, or none.

    Parameters
    ----------
    scene : str, Path or CompiledModel
        Scene file, or the model that was compiled from one.
    motion : Motion or Equilibrium, optional
        The motion to hold; after its end its last point is held.
    gains : Gains or Mpc, optional
        Feedback, or model-predictive control of `design_mpc`; without it the inputs of the motion alone
        act.
    estimator : Estimator, optional
        Estimates the state from measurements; without it steps take the state.
    distribution : TensionDistribution, optional
        Keeps tensions above the least ones.
    policy : Policy, optional
        Network that acts on observations, in place of motion, gains and all other parts; its description
        states sample, rates, ranges and delays.
    out : str or Path
        Folder, made if it does not exist.
    sample : float, optional [s]
        Time between two steps; by default that of the gains, 0.005 s without.
    limits : ActuatorLimits, optional
        Rates, ranges and delays of the actuators, by default those of the scene.
    arguments : mapping, optional
        Inputs of an equilibrium that was found with others than those of the scene; a motion has its own.
    code : ControllerCode, optional
        Name, precision, stored gains, solver, library and compiler of the C text.
    overwrite : bool
        Whether files may be replaced that are not as SHA256SUMS in the folder says.

    Returns
    -------
    ControllerBundle
        Folder, files, description; ``load()`` gives the compiled controller.

    Raises
    ------
    InvalidValueError
        A part is designed for another model or motion, a value is out of range, or the motion starts outside
        of the range of an actuator.
    FormulationError
        Coordinates depend on each other, or an unknown precision.
    OutputError
        The folder cannot be written, or holds files that may not be replaced.
    MissingSourceError
        The source of DAQP cannot be had, or is another one.
    CompilerMissingError, CompileError
        No C compiler was found, or it failed.

    Notes
    -----
    A step computes what a step of `simulate_control` computes: the same numbers to 1e-12 in double precision,
    where the gains are the same (``gains.at_knots(25)``). All memory is in a struct of the caller.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import build_controller, compile_scene, design_lqr, find_equilibrium
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> found = find_equilibrium(model)
    >>> gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    >>> controller = build_controller(model, found, gains, out="lift_controller").load()
    >>> controller.init()
    'ok'
    >>> controller.step_state(0.0, [*found.coordinate, 0.0])[0]
    'ok'
    """
    written = read_code(code)
    real = find_precision(written.precision, "precision")
    check_path(out, "out")
    check_switch(overwrite, "overwrite")
    check_folder(out)
    if policy is not None:
        check_alone(policy, {
            "motion": motion, "gains": gains, "estimator": estimator, "distribution": distribution,
            "sample": sample, "limits": limits, "arguments": arguments,
        })  # fmt: skip
    # Scene, motion and all parts of the controller.
    described, request = find_model_and_request(scene, motion)
    check_scene_name(described.manifest.name if written.name is None else written.name, "name")
    parts = collect_policy(described, policy, written) if policy is not None else collect_parts(
        described, find_motion(described, motion, arguments), gains=gains, estimator=estimator,
        distribution=distribution, sample=sample, limits=limits, code=written,
    )  # fmt: skip
    # Its texts, the library, and the folder with both.
    files = write_files(parts, replace(request, precision=real.name), real)
    contents = {file: text.encode("utf-8") for file, text in files.texts.items()}
    description = files.description
    if written.library:
        artifact = compile_library(
            files.sources(), name=f"{description.name}_control", compiler=find_compiler(written.compiler),
            flags=find_flags("reference"),
        )  # fmt: skip
        contents[artifact.file_name] = artifact.library
        description = replace(description, library=artifact.file_name)
    contents["manifest.json"] = description.to_json().encode("utf-8")
    protected = [*written.inputs, *([Path(scene)] if isinstance(scene, str | Path) else [])]
    folder = write_folder(out, contents, inputs=protected, overwrite=overwrite, listed=True)
    return ControllerBundle(folder, tuple(sorted(contents)), description)
