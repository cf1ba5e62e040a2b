"""From a scene file to a compiled C library that computes a tensegrity structure.

    from tensegrity_codegen import compile_scene, simulate
    model = compile_scene("prism.toml", for_=("simulate",))
    trajectory = simulate(model, t_end=2.0)

Names are loaded when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from tensegrity_codegen.version import VERSION as __version__

TYPE_CHECKING = False  # `typing` is loaded with the first name
if TYPE_CHECKING:
    from typing import Any

    from tensegrity_codegen.controller.build_controller import ControllerBundle, build_controller
    from tensegrity_codegen.controller.loaded import LoadedController, load_controller
    from tensegrity_codegen.controller.simulate_batch import simulate_control_batch
    from tensegrity_codegen.errors import TensegrityError
    from tensegrity_codegen.export.export_fmu import export_fmu
    from tensegrity_codegen.pictures.draw import draw
    from tensegrity_codegen.pictures.view import LivePage, view
    from tensegrity_codegen.pipeline import (
        build_library,
        compile_scene,
        load_scene,
        read_scene,
    )
    from tensegrity_codegen.request import ModelRequest
    from tensegrity_codegen.runtime.analysis.analyse import analyse
    from tensegrity_codegen.runtime.analysis.analysis import Analysis
    from tensegrity_codegen.runtime.control.closed_loop import simulate_control
    from tensegrity_codegen.runtime.control.design.estimator import Estimator
    from tensegrity_codegen.runtime.control.design.gains import Gains
    from tensegrity_codegen.runtime.control.equilibrium_path import EquilibriumPath
    from tensegrity_codegen.runtime.control.kalman import design_kalman
    from tensegrity_codegen.runtime.control.loop.control_run import ControlRun
    from tensegrity_codegen.runtime.control.loop.disturbances import Gust
    from tensegrity_codegen.runtime.control.lqr import design_lqr
    from tensegrity_codegen.runtime.control.motion import Motion
    from tensegrity_codegen.runtime.control.study.control_study import ControlStudy
    from tensegrity_codegen.runtime.control.study.stated_errors import RandomGust, StatedErrors
    from tensegrity_codegen.runtime.control.study.study import study_control
    from tensegrity_codegen.runtime.control.study.tuning import Tuning, choose_weights
    from tensegrity_codegen.runtime.control.tension_distribution import (
        TensionDistribution,
        design_distribution,
    )
    from tensegrity_codegen.runtime.control.time_motion import time_motion
    from tensegrity_codegen.runtime.linear.linearize import LinearModel, linearize
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.planning.outcome import PlanResult
    from tensegrity_codegen.runtime.planning.plan import plan
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.runtime.profiles.read_profile import read_profile
    from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity, equilibrium_sensitivity
    from tensegrity_codegen.runtime.simulate.simulate import simulate
    from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
    from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
    from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
    from tensegrity_codegen.runtime.statics.equilibrium import Equilibrium, find_equilibrium
    from tensegrity_codegen.runtime.trajectory.batch_trajectory import BatchTrajectory
    from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
    from tensegrity_codegen.scene.schema.schema import Scene
    from tensegrity_codegen.scene_functions import SymbolicFunctions, symbolic_functions
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.sweeps.sweep import sweep

__all__ = [
    "Analysis",
    "BatchTrajectory",
    "CompiledModel",
    "ControlRun",
    "ControlStudy",
    "ControllerBundle",
    "Equilibria",
    "Equilibrium",
    "EquilibriumPath",
    "Estimator",
    "Gains",
    "Gust",
    "LinearModel",
    "LivePage",
    "LoadedController",
    "ModelRequest",
    "Motion",
    "PlanResult",
    "Profile",
    "RandomGust",
    "Scene",
    "Sensitivity",
    "StatedErrors",
    "Structure",
    "SymbolicFunctions",
    "TensegrityError",
    "TensionDistribution",
    "Trajectory",
    "Tuning",
    "__version__",
    "analyse",
    "build_controller",
    "build_library",
    "choose_weights",
    "compile_scene",
    "design_distribution",
    "design_kalman",
    "design_lqr",
    "draw",
    "equilibrium_sensitivity",
    "export_fmu",
    "find_equilibria",
    "find_equilibrium",
    "linearize",
    "load_controller",
    "load_scene",
    "plan",
    "read_profile",
    "read_scene",
    "simulate",
    "simulate_batch",
    "simulate_control",
    "simulate_control_batch",
    "study_control",
    "sweep",
    "symbolic_functions",
    "time_motion",
    "view",
]

_HOME = {
    "Analysis": "runtime.analysis.analysis",
    "BatchTrajectory": "runtime.trajectory.batch_trajectory",
    "CompiledModel": "runtime.model.model",
    "ControlRun": "runtime.control.loop.control_run",
    "ControllerBundle": "controller.build_controller",
    "ControlStudy": "runtime.control.study.control_study",
    "Equilibria": "runtime.statics.batch.equilibria",
    "Equilibrium": "runtime.statics.equilibrium",
    "EquilibriumPath": "runtime.control.equilibrium_path",
    "Estimator": "runtime.control.design.estimator",
    "Gains": "runtime.control.design.gains",
    "Gust": "runtime.control.loop.disturbances",
    "LinearModel": "runtime.linear.linearize",
    "LivePage": "pictures.view",
    "LoadedController": "controller.loaded",
    "ModelRequest": "request",
    "Motion": "runtime.control.motion",
    "PlanResult": "runtime.planning.outcome",
    "Profile": "runtime.profiles.profile",
    "Scene": "scene.schema.schema",
    "RandomGust": "runtime.control.study.stated_errors",
    "Sensitivity": "runtime.sensitivity.record",
    "StatedErrors": "runtime.control.study.stated_errors",
    "Structure": "structure.structure",
    "SymbolicFunctions": "scene_functions",
    "TensionDistribution": "runtime.control.tension_distribution",
    "TensegrityError": "errors",
    "Trajectory": "runtime.trajectory.trajectory",
    "Tuning": "runtime.control.study.tuning",
    "analyse": "runtime.analysis.analyse",
    "build_controller": "controller.build_controller",
    "choose_weights": "runtime.control.study.tuning",
    "design_distribution": "runtime.control.tension_distribution",
    "design_kalman": "runtime.control.kalman",
    "design_lqr": "runtime.control.lqr",
    "draw": "pictures.draw",
    "equilibrium_sensitivity": "runtime.sensitivity.sensitivity",
    "export_fmu": "export.export_fmu",
    "find_equilibria": "runtime.statics.batch.find_equilibria",
    "find_equilibrium": "runtime.statics.equilibrium",
    "linearize": "runtime.linear.linearize",
    "load_controller": "controller.loaded",
    "plan": "runtime.planning.plan",
    "read_profile": "runtime.profiles.read_profile",
    "simulate": "runtime.simulate.simulate",
    "simulate_batch": "runtime.simulate.simulate_batch",
    "sweep": "sweeps.sweep",
    "symbolic_functions": "scene_functions",
    "time_motion": "runtime.control.time_motion",
    "simulate_control": "runtime.control.closed_loop",
    "simulate_control_batch": "controller.simulate_batch",
    "study_control": "runtime.control.study.study",
    "view": "pictures.view",
}


def __getattr__(name: str) -> Any:
    import importlib

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME.get(name, 'pipeline')}"), name)


def __dir__() -> list[str]:
    return [*__all__, *(name for name in globals() if name.startswith("__") and name not in __all__)]
