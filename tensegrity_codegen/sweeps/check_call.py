"""Arguments of `sweep` that are wrong whatever the scene: found before any work."""

import os
from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.engines.cluster import check_wait
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import InvalidValueError


def check_engine(workers: Any, scheduler: Any, wait: Any) -> None:
    """Raise InvalidValueError for where a sweep runs: two places, an empty address, an impossible wait."""
    if scheduler is not None and (not isinstance(scheduler, str) or not scheduler.strip()):
        raise InvalidValueError(
            "not the address of a scheduler",
            where="scheduler",
            given=scheduler,
            allowed="a text such as tcp://10.0.0.1:8786",
            hint="leave `scheduler` out for processes of this machine",
        )
    if scheduler is not None and workers is not None:
        raise InvalidValueError(
            "workers of this machine beside those of a cluster",
            where="workers",
            given=workers,
            allowed="`workers` or `scheduler`",
        )
    if wait is not None:
        check_wait(wait)
    if wait is not None and scheduler is None:
        raise InvalidValueError(
            "a time to wait for a scheduler, and no scheduler",
            where="wait",
            given=wait,
            allowed="with `scheduler`",
        )


def check_yes(yes: Any) -> None:
    """Raise InvalidValueError for what is neither yes nor no, such as the text "no"."""
    if not isinstance(yes, bool):
        raise InvalidValueError("neither yes nor no", where="yes", given=yes, allowed="True or False")


def check_on_progress(on_progress: Any) -> None:
    """Raise InvalidValueError for what cannot be called after each task."""
    if on_progress is not None and not callable(on_progress):
        raise InvalidValueError(
            "not a function", where="on_progress", given=on_progress, allowed="a function of a SweepProgress"
        )


def check_stop_after(stop_after: Any) -> None:
    """Raise InvalidValueError for what is no number of failed cases."""
    if stop_after is None:
        return
    check_whole(stop_after, "stop_after", 1, problem="not a number of cases")


def check_scene_source(scene: Any) -> None:
    """Raise InvalidValueError for what is no scene, and no name of a file."""
    if not isinstance(scene, str | os.PathLike | Mapping | Scene):
        raise InvalidValueError(
            "not a scene",
            where="scene",
            given=type(scene).__name__,
            allowed="the name of a scene file, a dictionary, or a Scene",
        )
