"""Figures of what there is: scenes, models, equilibria, samples of motions; of nodes and of bodies."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="pictures need matplotlib")

from tensegrity_codegen import compile_scene, draw, find_equilibrium, load_scene, read_scene, simulate
from tensegrity_codegen.cli.verbs.examples import read_example
from tensegrity_codegen.report.pictures.draw import draw_shot, find_shot
from tensegrity_codegen.report.pictures.view import PictureChoices
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tests.cases import thorough
from tests.live.pages import load, sway
from tests.rigid_scenes import HANGING as RODS


@pytest.fixture(scope="module", params=["planar", *thorough("lin_prism", "svd_tower")])
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / f"{request.param}.toml"
    path.write_text(read_example(request.param), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def model(scene: Path) -> CompiledModel:
    return compile_scene(scene, for_=("simulate", "equilibrium"))


def texts(figure: Any) -> str:
    from matplotlib.text import Text

    return "\n".join(item.get_text() for item in figure.findobj(Text))


def test_scenes_models_and_results_are_drawn(scene: Path, model: CompiledModel, tmp_path: Path) -> None:
    run = simulate(model, t_end=0.02, samples=3)
    found = find_equilibrium(model)
    read = read_scene(scene)
    subjects = (scene, str(scene), read, read.to_document(), load_scene(scene)[0], model, found, run)
    for subject in subjects:
        figure = draw(subject)
        assert model.manifest.name in texts(figure)
    assert "equilibrium: converged" in texts(draw(found))
    draw(run).savefig(tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_a_sample_is_chosen_by_number_or_by_time(model: CompiledModel) -> None:
    run = simulate(model, t_end=0.02, samples=3)
    for options, shown in (
        ({}, "0.02"),
        ({"sample": 0}, "0"),
        ({"time": 0.012}, "0.01"),
        ({"sample": -2}, "0.01"),
    ):
        assert f"t = {shown} s" in texts(draw(run, **options))
    for options in (
        {"sample": 3},
        {"sample": -4},
        {"sample": 0, "time": 0.0},
        {"time": 0.03},
        {"time": -1.0},
    ):
        with pytest.raises(InvalidValueError):
            draw(run, **options)
    with pytest.raises(InvalidValueError, match="only motions and plans"):
        draw(model, time=0.0)


def test_names_and_a_title_are_written(model: CompiledModel) -> None:
    shown = texts(draw(model, labels=True, title="a title"))
    assert "a title" in shown
    assert model.manifest.node_name[0] in shown


@pytest.mark.parametrize("subject", [3, None, [1, 2], object()])
def test_other_things_are_refused(subject: Any) -> None:
    with pytest.raises(InvalidValueError, match="cannot be drawn"):
        draw(subject)


def test_results_of_a_library_alone_are_refused(model: CompiledModel) -> None:
    alone = CompiledModel(model.path, model.manifest)
    with pytest.raises(InvalidValueError, match="without its scene"):
        draw(simulate(alone, t_end=0.01, samples=2))


@pytest.mark.thorough
def test_a_scene_and_its_model_are_drawn_at_their_equilibrium(scene: Path, model: CompiledModel) -> None:
    found = find_equilibrium(model)
    for subject in (scene, model, load_scene(scene)[0]):
        figure = draw(subject, settle=True, labels="nodes", size="500x400", follow=False)
        assert model.manifest.node_name[0] in texts(figure)
        width, height = figure.get_size_inches() * figure.dpi
        assert (round(width), round(height)) == (500, 400)
    with pytest.raises(InvalidValueError, match="equilibrium"):
        draw(found, settle=True)


@pytest.mark.thorough
def test_axes_of_a_sample_fit_it_or_the_whole_motion(model: CompiledModel) -> None:
    run = simulate(model, t_end=0.2, samples=3)
    for follow in (True, False):
        assert "t = 0 s" in texts(draw(run, sample=0, follow=follow, color="force_density"))


@pytest.mark.parametrize("name", ["forces", "settle", "follow"])
def test_switches_are_true_or_false(name: str) -> None:
    for subject in (load("prism"), sway(load("prism"), 3)):
        with pytest.raises(InvalidValueError, match="True or False") as caught:
            draw(subject, **{name: "no"})
        assert caught.value.where == name


def test_what_does_not_move_is_not_followed() -> None:
    with pytest.raises(InvalidValueError, match="nothing moves"):
        draw(load("prism"), follow=True)


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_samples_that_are_not_finite_are_named(wrong: float) -> None:
    motion = sway(load("prism"), 7)
    for name in ("node_position", "member_tension"):
        values = getattr(motion, name).copy()
        values[5, -1] = wrong
        spoilt = replace(motion, **{name: values})
        for more in ({"sample": 5}, {"sample": 2, "follow": False}):
            with pytest.raises(NonFiniteError, match=f"{name} of sample 5 is not finite"):
                draw(spoilt, **more)
        draw(spoilt, sample=2)


def test_rigid_bodies_have_faces_and_bars_of_bodies_unknown_tensions() -> None:
    from matplotlib.collections import PolyCollection

    tower = tower_of_bodies()
    figure = draw(tower)
    shown = texts(figure)
    for words in ("rigid body", "tension unknown", "1 rigid body, 6 bars", "reactions unknown"):
        assert words in shown, shown
    faces = [item for item in figure.axes[0].collections if isinstance(item, PolyCollection)]
    assert any(len(item.get_paths()) == 1 for item in faces)


def tower_of_bodies() -> Any:
    return load_scene(read_scene(tomllib.loads(read_example("svd_tower"))))[0]


def test_bodies_beside_nodes_are_drawn_by_their_surfaces() -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    structure = load_scene(RODS)[0]
    assert isinstance(structure, Structure)
    figure = draw(structure, labels=True)
    shown = texts(figure)
    for words in ("rod_top", "block_eye", "line", "tie", "4 nodes, 2 rigid bodies, 2 cables"):
        assert words in shown, shown
    assert "corner" not in shown
    assert "edge" not in shown
    drawn = figure.axes[0].collections
    assert 6 in [len(item.get_segments()) for item in drawn if isinstance(item, LineCollection)]  # 3 a cable
    surfaces = [item for item in drawn if isinstance(item, PolyCollection) and len(item.get_paths()) > 100]
    assert len(surfaces) == 1
    _, tension = draw_shot(find_shot(structure), PictureChoices())
    np.testing.assert_array_equal(tension, structure.static_tension()[:2])


def test_a_picture_out_of_balance_says_so() -> None:
    assert "not in balance: t1 lacks 3.57 N" in texts(draw(load("prism")))
    assert "balance" not in texts(draw(load("prism"), settle=True))
