"""Natural modes and mechanisms for live pages."""

from collections.abc import Callable

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.settle import move_near_origin, with_statics
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.runtime.analysis.analysis import Analysis
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.request import ModelRequest

MOST_COORDINATES = 1000  # of structures whose modes are found; the analysis takes dense matrices


def find_modes(
    subject: Subject, request: ModelRequest, count: int, warn: Callable[[str], None]
) -> tuple[Analysis | None, str]:
    """Return the analysis with natural modes and mechanisms, or None and why there is none.

    Parameters
    ----------
    subject : Structure or BodySystem
        At the positions at which modes are found.
    request : ModelRequest
        Its request.
    count : int
        Number of modes; 0 for no analysis.
    warn : callable
        Called with a sentence where the analysis fails.

    Returns
    -------
    analysis : Analysis or None
        The analysis.
    note : str
        Why there is none, or "".
    """
    if count == 0:
        return None, ""
    size = subject.n_coordinates
    if size > MOST_COORDINATES:
        return None, f"No modes: more than {MOST_COORDINATES} coordinates ({size})."
    if size == 0:
        return None, "No modes: no node can move."
    try:
        near, _ = move_near_origin(subject, request)
        statics = with_statics(near, request)
        wanted = find_needs("analyse", near, statics).alone(statics)
        return analyse(build_library(near, wanted).load(), n_modes=count), ""
    except TensegrityError as error:
        warn(f"the page has no modes: {error.problem}")
        return None, f"No modes: {error.problem}."
