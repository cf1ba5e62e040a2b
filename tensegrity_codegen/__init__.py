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
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.control.feedback.study.stated_errors import Draws, RandomGust, StatedErrors
    from tensegrity_codegen.control.feedback.study.study import study_control
    from tensegrity_codegen.control.feedback.study.tuning import Tuning, choose_weights
    from tensegrity_codegen.control.feedback.time_motion import record_motion, time_motion
    from tensegrity_codegen.control.planning.plan import plan
    from tensegrity_codegen.export.export_acados import export_acados
    from tensegrity_codegen.export.export_fmu import export_fmu
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
    "Design",
    "Disturbance",
    "Draws",
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
    "PlanResult",
    "Profile",
    "RandomGust",
    "Sampling",
    "Scene",
    "SegmentError",
    "Sensitivity",
    "Sizing",
    "Stand",
    "StatedErrors",
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
    "view",
]

_HOME = {
    "ActuatorLimits": "control.feedback.loop.actuator_bounds",
    "ControllerCode": "control.embedded.parts",
    "Disturbance": "control.feedback.loop.sampled_plant",
    "Draws": "control.feedback.study.stated_errors",
    "Stepping": "runtime.integrate.options",
    "Until": "runtime.simulate.simulate",
    "Analysis": "runtime.analysis.analyse",
    "BatchTrajectory": "runtime.trajectory.trajectory",
    "Catenary": "structure.catenary",
    "Cluster": "sweeps.engines.dask_engine",
    "CompiledModel": "runtime.model.model",
    "ControlRun": "control.feedback.loop.control_run",
    "ControllerBundle": "control.embedded.build_controller",
    "ControlStudy": "control.feedback.study.control_study",
    "Equilibria": "runtime.statics.batch.equilibria",
    "Equilibrium": "runtime.statics.equilibrium_record",
    "EquilibriumPath": "control.feedback.equilibrium_path",
    "Estimator": "control.feedback.design.gains",
    "Gains": "control.feedback.design.gains",
    "Identification": "sweeps.fitting.identification",
    "identify": "sweeps.fitting.identify",
    "Design": "sweeps.fitting.optimise",
    "LossGradient": "sweeps.fitting.optimise",
    "optimise": "sweeps.fitting.optimise",
    "Gait": "sweeps.gaits.gait",
    "Walk": "sweeps.gaits.gait",
    "design_gait": "sweeps.gaits.gait",
    "Form": "pipeline.forming.form",
    "form": "pipeline.forming.form",
    "Gust": "control.feedback.loop.sampled_plant",
    "LinearModel": "runtime.linear.linearize",
    "LivePage": "live.live_page",
    "LoadedController": "control.embedded.loaded",
    "ModelRequest": "tables.request",
    "Motion": "runtime.records.timed_motion",
    "motion_function": "pipeline.motion_function",
    "MotionGradient": "runtime.simulate.gradient",
    "Mpc": "control.feedback.mpc",
    "motion_gradient": "runtime.simulate.gradient",
    "PlanResult": "runtime.records.plan_result",
    "Profile": "runtime.profiles.profile",
    "Sampling": "sweeps.cases.sampled",
    "Scene": "scene.schema.schema",
    "RandomGust": "control.feedback.study.stated_errors",
    "SegmentError": "runtime.statics.equilibrium_record",
    "Sensitivity": "runtime.sensitivity.sensitivity",
    "Sizing": "pipeline.sizing.size_members",
    "size_members": "pipeline.sizing.size_members",
    "Stand": "runtime.contacts.judge_stand",
    "StatedErrors": "control.feedback.study.stated_errors",
    "Structure": "structure.structure",
    "SymbolicFunctions": "pipeline.scene_functions",
    "TensionDistribution": "control.feedback.loop.tension_distribution",
    "TensegrityError": "system.errors",
    "Trajectory": "runtime.trajectory.trajectory",
    "Tuning": "control.feedback.study.tuning",
    "add_segment_error": "pipeline.segment_error",
    "analyse": "runtime.analysis.analyse",
    "build_library": "pipeline.build_library",
    "compile_scene": "pipeline.compile_scene",
    "load_scene": "pipeline.compile_scene",
    "read_scene": "scene.read",
    "build_controller": "control.embedded.build_controller",
    "choose_weights": "control.feedback.study.tuning",
    "design_distribution": "control.feedback.loop.tension_distribution",
    "design_kalman": "control.feedback.kalman",
    "design_lqr": "control.feedback.lqr",
    "design_mpc": "control.feedback.mpc",
    "draw": "live.draw",
    "equilibrium_sensitivity": "runtime.sensitivity.sensitivity",
    "export_acados": "export.export_acados",
    "export_fmu": "export.export_fmu",
    "find_catenary": "structure.catenary",
    "find_equilibria": "runtime.statics.batch.find_equilibria",
    "find_equilibrium": "runtime.paths.find_equilibrium",
    "linearize": "runtime.linear.linearize",
    "load_controller": "control.embedded.loaded",
    "plan": "control.planning.plan",
    "read_profile": "runtime.profiles.read_profile",
    "record_motion": "control.feedback.time_motion",
    "simulate": "runtime.simulate.simulate",
    "simulate_batch": "runtime.simulate.simulate_batch",
    "stand": "runtime.analysis.stand",
    "sweep": "sweeps.sweep",
    "symbolic_functions": "pipeline.scene_functions",
    "time_motion": "control.feedback.time_motion",
    "simulate_control": "control.feedback.closed_loop",
    "simulate_control_batch": "control.embedded.closed_loop",
    "study_control": "control.feedback.study.study",
    "view": "live.live_page",
}


def __getattr__(name: str) -> "Any":
    import importlib

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__") and name not in __all__)]
