"""From a scene file to a compiled C library that computes a tensegrity structure.

    from tensegrity_codegen import compile_scene, simulate
    model = compile_scene("prism.toml", for_=("simulate",))
    trajectory = simulate(model, t_end=2.0)

Names are loaded when first used, so that importing the package costs nothing.
"""

from tensegrity_codegen.system.version import VERSION as __version__

TYPE_CHECKING = False  # `typing` is loaded with the first name
if TYPE_CHECKING:
    from typing import Any

    from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
    from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
    from tensegrity_codegen.control.embedded.loaded import LoadedController, load_controller
    from tensegrity_codegen.control.embedded.parts import ControllerCode
    from tensegrity_codegen.control.feedback.closed_loop import simulate_control
    from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
    from tensegrity_codegen.control.feedback.equilibrium_path import EquilibriumPath
    from tensegrity_codegen.control.feedback.kalman import design_kalman
    from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
    from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
    from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
    from tensegrity_codegen.control.feedback.loop.tension_distribution import (
        TensionDistribution,
        design_distribution,
    )
    from tensegrity_codegen.control.feedback.lqr import design_lqr
    from tensegrity_codegen.control.feedback.mpc import Mpc, design_mpc
    from tensegrity_codegen.control.feedback.policy import Acted, Description, Observed, Policy, read_policy
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.control.feedback.study.stated_errors import Draws, RandomGust, StatedErrors
    from tensegrity_codegen.control.feedback.study.study import study_control
    from tensegrity_codegen.control.feedback.study.tuning import Tuning, choose_weights
    from tensegrity_codegen.control.feedback.time_motion import record_motion, time_motion
    from tensegrity_codegen.control.planning.plan import plan
    from tensegrity_codegen.export.export_acados import export_acados
    from tensegrity_codegen.export.export_fmu import export_fmu
    from tensegrity_codegen.learning.derivatives.to_jax import to_jax, to_jax_motion
    from tensegrity_codegen.learning.derivatives.to_torch import to_torch, to_torch_motion
    from tensegrity_codegen.learning.environment import environment
    from tensegrity_codegen.learning.step import EnvironmentStep
    from tensegrity_codegen.live.draw import draw
    from tensegrity_codegen.live.live_page import LivePage, view
    from tensegrity_codegen.pipeline.build_library import build_library
    from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
    from tensegrity_codegen.pipeline.forming.form import Form, form
    from tensegrity_codegen.pipeline.motion_function import motion_function
    from tensegrity_codegen.pipeline.scene_functions import SymbolicFunctions, symbolic_functions
    from tensegrity_codegen.pipeline.segment_error import add_segment_error
    from tensegrity_codegen.pipeline.sizing.size_members import Sizing, size_members
    from tensegrity_codegen.runtime.analysis.analyse import Analysis, analyse
    from tensegrity_codegen.runtime.analysis.stand import stand
    from tensegrity_codegen.runtime.contacts.judge_stand import Stand
    from tensegrity_codegen.runtime.integrate.options import Stepping
    from tensegrity_codegen.runtime.linear.linearize import LinearModel, linearize
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.runtime.profiles.read_profile import read_profile
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity, equilibrium_sensitivity
    from tensegrity_codegen.runtime.simulate.gradient import MotionGradient, motion_gradient
    from tensegrity_codegen.runtime.simulate.simulate import Until, simulate
    from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
    from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
    from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium, SegmentError
    from tensegrity_codegen.runtime.stepper.stepper import Stepper
    from tensegrity_codegen.runtime.trajectory.trajectory import BatchTrajectory, Trajectory
    from tensegrity_codegen.scene.read import read_scene
    from tensegrity_codegen.scene.schema.schema import Scene
    from tensegrity_codegen.structure.catenary import Catenary, find_catenary
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.sweeps.cases.sampled import Sampling
    from tensegrity_codegen.sweeps.engines.dask_engine import Cluster
    from tensegrity_codegen.sweeps.fitting.identification import Identification
    from tensegrity_codegen.sweeps.fitting.identify import identify
    from tensegrity_codegen.sweeps.fitting.optimise import Design, LossGradient, optimise
    from tensegrity_codegen.sweeps.gaits.gait import Gait, Walk, design_gait
    from tensegrity_codegen.sweeps.sweep import sweep
    from tensegrity_codegen.system.errors import TensegrityError
    from tensegrity_codegen.tables.request import ModelRequest

__all__ = [
    "Acted",
    "ActuatorLimits",
    "Analysis",
    "BatchTrajectory",
    "Catenary",
    "Cluster",
    "CompiledModel",
    "ControlRun",
    "ControlStudy",
    "ControllerBundle",
    "ControllerCode",
    "Description",
    "Design",
    "Disturbance",
    "Draws",
    "EnvironmentStep",
    "Equilibria",
    "Equilibrium",
    "EquilibriumPath",
    "Estimator",
    "Form",
    "Gains",
    "Gait",
    "Gust",
    "Identification",
    "LinearModel",
    "LivePage",
    "LoadedController",
    "LossGradient",
    "ModelRequest",
    "Motion",
    "MotionGradient",
    "Mpc",
    "Observed",
    "PlanResult",
    "Policy",
    "Profile",
    "RandomGust",
    "Sampling",
    "Scene",
    "SegmentError",
    "Sensitivity",
    "Sizing",
    "Stand",
    "StatedErrors",
    "Stepper",
    "Stepping",
    "Structure",
    "SymbolicFunctions",
    "TensegrityError",
    "TensionDistribution",
    "Trajectory",
    "Tuning",
    "Until",
    "Walk",
    "__version__",
    "add_segment_error",
    "analyse",
    "build_controller",
    "build_library",
    "choose_weights",
    "compile_scene",
    "design_distribution",
    "design_gait",
    "design_kalman",
    "design_lqr",
    "design_mpc",
    "draw",
    "environment",
    "equilibrium_sensitivity",
    "export_acados",
    "export_fmu",
    "find_catenary",
    "find_equilibria",
    "find_equilibrium",
    "form",
    "identify",
    "linearize",
    "load_controller",
    "load_scene",
    "motion_function",
    "motion_gradient",
    "optimise",
    "plan",
    "read_policy",
    "read_profile",
    "read_scene",
    "record_motion",
    "simulate",
    "simulate_batch",
    "simulate_control",
    "simulate_control_batch",
    "size_members",
    "stand",
    "study_control",
    "sweep",
    "symbolic_functions",
    "time_motion",
    "to_jax",
    "to_jax_motion",
    "to_torch",
    "to_torch_motion",
    "view",
]

_NAMES = {
    "control.embedded.build_controller": ("ControllerBundle", "build_controller"),
    "control.embedded.closed_loop": ("simulate_control_batch",),
    "control.embedded.loaded": ("LoadedController", "load_controller"),
    "control.embedded.parts": ("ControllerCode",),
    "control.feedback.closed_loop": ("simulate_control",),
    "control.feedback.design.gains": ("Estimator", "Gains"),
    "control.feedback.equilibrium_path": ("EquilibriumPath",),
    "control.feedback.kalman": ("design_kalman",),
    "control.feedback.loop.actuator_bounds": ("ActuatorLimits",),
    "control.feedback.loop.control_run": ("ControlRun",),
    "control.feedback.loop.sampled_plant": ("Disturbance", "Gust"),
    "control.feedback.loop.tension_distribution": ("TensionDistribution", "design_distribution"),
    "control.feedback.lqr": ("design_lqr",),
    "control.feedback.mpc": ("Mpc", "design_mpc"),
    "control.feedback.policy": ("Acted", "Description", "Observed", "Policy", "read_policy"),
    "control.feedback.study.control_study": ("ControlStudy",),
    "control.feedback.study.stated_errors": ("Draws", "RandomGust", "StatedErrors"),
    "control.feedback.study.study": ("study_control",),
    "control.feedback.study.tuning": ("Tuning", "choose_weights"),
    "control.feedback.time_motion": ("record_motion", "time_motion"),
    "control.planning.plan": ("plan",),
    "export.export_acados": ("export_acados",),
    "export.export_fmu": ("export_fmu",),
    "learning.derivatives.to_jax": ("to_jax", "to_jax_motion"),
    "learning.derivatives.to_torch": ("to_torch", "to_torch_motion"),
    "learning.environment": ("environment",),
    "learning.step": ("EnvironmentStep",),
    "live.draw": ("draw",),
    "live.live_page": ("LivePage", "view"),
    "pipeline.build_library": ("build_library",),
    "pipeline.compile_scene": ("compile_scene", "load_scene"),
    "pipeline.forming.form": ("Form", "form"),
    "pipeline.motion_function": ("motion_function",),
    "pipeline.scene_functions": ("SymbolicFunctions", "symbolic_functions"),
    "pipeline.segment_error": ("add_segment_error",),
    "pipeline.sizing.size_members": ("Sizing", "size_members"),
    "runtime.analysis.analyse": ("Analysis", "analyse"),
    "runtime.analysis.stand": ("stand",),
    "runtime.contacts.judge_stand": ("Stand",),
    "runtime.integrate.options": ("Stepping",),
    "runtime.linear.linearize": ("LinearModel", "linearize"),
    "runtime.model.model": ("CompiledModel",),
    "runtime.paths.find_equilibrium": ("find_equilibrium",),
    "runtime.profiles.profile": ("Profile",),
    "runtime.profiles.read_profile": ("read_profile",),
    "runtime.records.plan_result": ("PlanResult",),
    "runtime.records.timed_motion": ("Motion",),
    "runtime.sensitivity.sensitivity": ("Sensitivity", "equilibrium_sensitivity"),
    "runtime.simulate.gradient": ("MotionGradient", "motion_gradient"),
    "runtime.simulate.simulate": ("Until", "simulate"),
    "runtime.simulate.simulate_batch": ("simulate_batch",),
    "runtime.statics.batch.equilibria": ("Equilibria",),
    "runtime.statics.batch.find_equilibria": ("find_equilibria",),
    "runtime.statics.equilibrium_record": ("Equilibrium", "SegmentError"),
    "runtime.stepper.stepper": ("Stepper",),
    "runtime.trajectory.trajectory": ("BatchTrajectory", "Trajectory"),
    "scene.read": ("read_scene",),
    "scene.schema.schema": ("Scene",),
    "structure.catenary": ("Catenary", "find_catenary"),
    "structure.structure": ("Structure",),
    "sweeps.cases.sampled": ("Sampling",),
    "sweeps.engines.dask_engine": ("Cluster",),
    "sweeps.fitting.identification": ("Identification",),
    "sweeps.fitting.identify": ("identify",),
    "sweeps.fitting.optimise": ("Design", "LossGradient", "optimise"),
    "sweeps.gaits.gait": ("Gait", "Walk", "design_gait"),
    "sweeps.sweep": ("sweep",),
    "system.errors": ("TensegrityError",),
    "tables.request": ("ModelRequest",),
}


def __getattr__(name: str) -> "Any":
    import importlib

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = next(module for module, names in _NAMES.items() if name in names)
    return getattr(importlib.import_module(f"{__name__}.{home}"), name)


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__") and name not in __all__)]
