"""A live page as one HTML file: data, modules and three.js inside, nothing from outside."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.live.channels import pack_text
from tensegrity_codegen.live.live_scene import LiveScene
from tensegrity_codegen.report.pages.html_template import html_template

FIRST, WORKER = "boot", "worker"  # scripts that are no modules
HINT = "Point at a member or node; click to keep it here."
PULL_HINT = "Drag a node to pull it; click a member to keep its numbers here."


def live_folder() -> Path:
    """Return the folder of the page's scripts and styles."""
    return template_folder() / "live"


def render_live(scene: LiveScene, three: str, licence: str) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    scene : LiveScene
        What is shown.
    three, licence : str
        The module of three.js and its licences, of `find_three`.

    Returns
    -------
    str
        The file.
    """
    folder = live_folder()
    texts = {path.stem: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.js"))}
    channels = [{"name": name, "data": channel.data} for name, channel in scene.channels.items()]
    data = {**scene.data, "channels": {name: item.describe() for name, item in scene.channels.items()}}
    is_running = "engine" in scene.data
    return html_template("live", "page.html.j2").render(
        title=scene.title,
        headline=scene.headline,
        facts=scene.facts,
        warnings=scene.warnings,
        style=_raw((folder / "style.css").read_text(encoding="utf-8")),
        scene=_raw(_as_json(data)),
        channels=channels,
        modules=[
            {"name": name, "text": _raw(text)} for name, text in texts.items() if name not in (FIRST, WORKER)
        ],
        worker=_raw(texts[WORKER]) if is_running else "",
        hint=PULL_HINT if is_running else HINT,
        boot=_raw(texts[FIRST]),
        three=pack_text(three),
        licence=licence,
    )


def _as_json(data: Mapping[str, Any]) -> str:
    """Return JSON that ends no script element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _raw(text: str) -> Markup:
    """Return text that stands in the page as it is; it must not end the element that it stands in."""
    if "</s" in text.lower():
        raise ValueError("text of a script or style that would end its element")
    return Markup(text)
