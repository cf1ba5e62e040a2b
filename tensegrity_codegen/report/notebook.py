"""Results in notebooks: a table of facts and, where matplotlib is installed, a picture."""

import base64
import io
from typing import Any

from markupsafe import escape

from tensegrity_codegen.report.pictures.draw import draw_shot, find_shot
from tensegrity_codegen.report.pictures.view import PictureChoices
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.summaries import Summarised

DRAWN = (CompiledModel, Equilibrium, PlanResult, Scene, Structure, BodySystem, Trajectory)
DPI = 80  # of pictures
LEFT = 'style="text-align:left"'
SIDE_BY_SIDE = 'style="display:flex;flex-wrap:wrap;gap:1em;align-items:flex-start"'
MAX_MEMBERS = 3000  # of structures that are drawn without being asked


def build_html(result: Summarised) -> str:
    """Return the HTML that a notebook shows of a result: name, table of facts, picture."""
    rows = "".join(
        f"<tr><th {LEFT}>{escape(name)}</th><td {LEFT}>{escape(text)}</td></tr>"
        for name, text in result.facts()
    )
    head = ": ".join(title for title in (type(result).__name__, result.headline()) if title)
    table = f"<table><caption {LEFT}><b>{escape(head)}</b></caption>{rows}</table>"
    return f"<div {SIDE_BY_SIDE}>{table}{_picture(result)}</div>"


def _picture(result: Any) -> str:
    """Return an image, or "" for a result without picture, a large structure, or without matplotlib."""
    try:
        if isinstance(result, Motion):
            figure = _plot_rest_lengths(result)
        elif isinstance(result, DRAWN) and _count_members(result) <= MAX_MEMBERS:
            figure, _ = draw_shot(find_shot(result), PictureChoices(follow=True))
        else:
            return ""
        data = io.BytesIO()
        figure.savefig(data, format="png", dpi=DPI)
    except TensegrityError:  # no matplotlib, no structure, positions that are not finite
        return ""
    text = base64.b64encode(data.getvalue()).decode("ascii")
    return f'<img alt="picture" style="max-width:100%" src="data:image/png;base64,{text}">'


def _count_members(result: Any) -> int:
    structure = result if isinstance(result, Structure | BodySystem) else getattr(result, "structure", None)
    return 0 if structure is None else int(structure.n_members)


def _plot_rest_lengths(motion: Motion) -> Any:
    """Return a figure of the actuators' rest lengths over time."""
    from tensegrity_codegen.report.pictures.canvas import new_figure

    figure = new_figure(5.0, 3.2)
    axes = figure.add_subplot()
    for name, values in zip(motion.actuators, motion.rest_length.T, strict=True):
        axes.plot(motion.time, values, label=name)
    axes.set(xlabel="time [s]", ylabel="rest length [m]")
    if len(motion.actuators) <= 12:
        axes.legend(fontsize=7)
    return figure
