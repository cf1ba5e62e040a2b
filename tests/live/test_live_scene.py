"""What a live page shows: positions, tensions, reactions, uses, modes."""

import base64
import gzip
import re
from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen import load_scene
from tensegrity_codegen.codegen.print.render import paste_text, plain_c_folder, template_folder
from tensegrity_codegen.live import live_scene
from tensegrity_codegen.live.live_scene import (
    Channel,
    build_live_scene,
    choose_view,
    compute_uses,
    pack,
    pack_rounded,
    pack_text,
)
from tensegrity_codegen.report.loads import compute_reactions
from tensegrity_codegen.report.pictures.view import read_view
from tensegrity_codegen.structure.body_meshes import build_mesh
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.structure.structure import Structure
from tests.ground_cases import make_slope
from tests.live.pages import load, sway
from tests.rigid_scenes import HANGING as RODS


def unpack(channel: Channel) -> np.ndarray:
    raw = gzip.decompress(base64.b64decode(channel.data))
    values = np.frombuffer(raw, dtype=np.dtype(channel.kind).newbyteorder("<")).reshape(channel.shape)
    if channel.kind != "int16":
        return values.astype(float)
    rows = values.reshape(channel.shape[0], -1).copy()
    for k in range(1, len(rows)):
        rows[k] += rows[k - 1]
    last = np.where(rows == live_scene.UNKNOWN, np.nan, rows).reshape(-1, len(channel.scale))
    return (last * np.array(channel.scale) + np.array(channel.offset)).reshape(channel.shape)


@pytest.mark.parametrize("kind", ["float64", "float32", "int32", "uint8"])
def test_an_array_is_kept_as_it_is(kind: str) -> None:
    values = np.arange(24).reshape(2, 3, 4)
    channel = pack(values, kind)
    assert channel.rounding == 0.0
    assert np.array_equal(unpack(channel), values)


@pytest.mark.parametrize("most", [10**6, 10])
@pytest.mark.parametrize("by_place", [False, True])
def test_the_stated_rounding_holds(most: int, by_place: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_scene, "MAX_FLOATS", most)
    random = np.random.default_rng(3)
    values = random.normal(size=(40, 7, 3)) * np.array([1e-3, 1.0, 50.0])
    channel = pack_rounded(values, by_place=by_place)
    assert channel.kind == ("float32" if most > 10 else "int16")
    difference = np.abs(unpack(channel) - values)
    assert 0 < difference.max() <= channel.rounding * (1 + 1e-12)
    if by_place and most == 10:  # each place has steps that suit it
        assert (difference.max(axis=(0, 1)) <= np.ptp(values, axis=(0, 1)) / 50000).all()


@pytest.mark.parametrize("most", [10**6, 10])
def test_zero_signs_and_unknown_numbers_are_kept(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_scene, "MAX_FLOATS", most)
    values = np.array([[0.0, 1e-6, -1e-6, 100.0], [np.nan, 0.0, 3.0, -100.0], [0.0] * 4, [np.nan] * 4])
    found = unpack(pack_rounded(values))
    assert np.array_equal(np.isnan(found), np.isnan(values))
    assert np.array_equal(np.sign(found[0]), np.sign(values[0]))


@pytest.mark.parametrize("most", [10**6, 0])
def test_arrays_without_known_numbers_are_kept(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_scene, "MAX_FLOATS", most)
    for values in (np.full((2, 3), np.nan), np.zeros((2, 3)), np.full((1, 3), 5.0)):
        channel = pack_rounded(values, by_place=True)
        assert unpack(channel) == pytest.approx(values, nan_ok=True)
        assert channel.rounding == pytest.approx(0.0, abs=1e-12)


def test_text_is_compressed() -> None:
    text = "three " * 1000
    assert len(pack_text(text)) < 200
    assert gzip.decompress(base64.b64decode(pack_text(text))).decode() == text


def moved(structure, offset):
    return structure.with_changes(node_position=structure.node_position + offset)


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_positions_do_not_lose_digits_far_from_the_origin(offset: float) -> None:
    structure = moved(load("prism"), offset)
    motion = sway(structure)
    scene = build_live_scene(structure, motion)
    found = unpack(scene.channels["node_position"]) + np.array(scene.data["origin"])
    rounding = scene.data["rounding"]["node_position"]
    assert rounding < 1e-7 * np.ptp(motion.node_position)
    assert np.abs(found - motion.node_position).max() <= rounding + 1e-12
    tension = unpack(scene.channels["member_tension"])
    assert np.abs(tension - motion.member_tension).max() <= scene.data["rounding"]["member_tension"]


def test_reactions_balance_loads_and_weight_where_tensions_balance() -> None:
    # A hanging cable: its support carries the load and the weight of the node.
    structure = load("two_nodes")
    weight = structure.node_mass[:, None] * structure.gravity
    held = np.flatnonzero(structure.node_anchored.any(axis=1))
    free = 1 - int(held[0])
    force = structure.node_load[free] + weight[free]
    unit = structure.node_position[held[0]] - structure.node_position[free]
    tension = np.array([[-force @ unit / np.linalg.norm(unit)]])
    found = compute_reactions(structure, structure.node_position[None], tension, held)
    total = found[0, 0] + structure.node_load.sum(axis=0) + weight.sum(axis=0)
    assert total == pytest.approx(np.zeros(3), abs=1e-12)


def test_reactions_act_along_anchored_axes_only_and_unknown_tensions_leave_them_unknown() -> None:
    structure = load("tower")
    held = np.flatnonzero(structure.node_anchored.any(axis=1))
    tension = structure.static_tension()[None]
    found = compute_reactions(structure, structure.node_position[None], tension, held)
    assert not found[0][~structure.node_anchored[held]].any()
    assert found[0][structure.node_anchored[held]].any()
    lost = tension.copy()
    lost[0, structure.is_bar] = np.nan
    unknown = compute_reactions(structure, structure.node_position[None], lost, held)
    assert np.isnan(unknown[0][structure.node_anchored[held]]).all()


def test_uses_are_those_of_the_analysis() -> None:
    structure = load("prism12")
    count = structure.n_members
    limited = structure.with_changes(limits=replace(structure.limits, most_tension=np.full(count, 15.0)))
    position, tension = structure.node_position[None], structure.static_tension()[None]
    found = compute_uses(limited, limited, position, tension)
    assert found is not None
    use = check_members(limited, tension[0], structure.member_length()).use
    assert found[0] == pytest.approx(np.fmax.reduce(list(use.values())), nan_ok=True)
    assert compute_uses(load("prism"), load("prism"), position, tension) is None


def test_bars_of_bodies_have_unknown_tensions_and_not_zero() -> None:
    scene = build_live_scene(load("svd_tower"))
    assert (scene.data["largest_reaction"], scene.data["unknown_reactions"]) == (0.0, 3)
    tension = unpack(scene.channels["member_tension"])[0]
    is_bar = unpack(scene.channels["is_bar"]).astype(bool)
    assert np.isnan(tension[is_bar]).all()
    assert not np.isnan(tension[~is_bar]).any()


def test_a_simulation_that_failed_is_named() -> None:
    structure = load("prism")
    motion = replace(sway(structure, 5), status="unstable", message="the energy grows")
    scene = build_live_scene(structure, motion)
    assert "status unstable" in scene.headline
    assert any("the energy grows" in fact for fact in scene.facts)


@pytest.mark.parametrize(
    ("axes", "across", "is_planar"),
    [((0, 1, 2), None, False), ((0, 2), 1, True), ((0, 1), 2, True), ((1, 2), 0, True), ((2,), 1, True)],
)
def test_planes_are_looked_at_along_their_normal(
    axes: tuple[int, ...], across: int | None, is_planar: bool
) -> None:
    view = choose_view(axes, is_supported=False)
    assert view["is_planar"] == is_planar
    if across is not None:
        assert np.flatnonzero(view["view"]).tolist() == [across]
        assert across not in view["ground"]
    assert np.dot(view["up"], view["view"]) < 0.9 * np.linalg.norm(view["view"])


@pytest.mark.parametrize(
    ("text", "is_flat"), [("top", True), ("iso", True), ("-60,16", False), (None, False)]
)
def test_named_views_are_parallel_projections_as_in_pictures(text: str | None, is_flat: bool) -> None:
    view = choose_view((0, 1, 2), is_supported=False, direction=read_view(text))
    assert view["is_flat"] == is_flat


def test_the_plane_of_the_ground_is_counted_from_the_origin_of_the_page() -> None:
    slope, _ = make_slope(0.3)
    data = build_live_scene(slope).data
    ground = slope.ground
    assert ground is not None
    assert data["plane"]["normal"] == ground.normal.tolist()
    assert data["plane"]["offset"] == pytest.approx(-float(ground.normal @ data["origin"]), abs=1e-15)
    assert build_live_scene(load("prism")).data["plane"] is None


def test_the_memory_of_a_page_holds_the_run_of_its_library() -> None:
    """Worker.js lays out the struct of a run itself: pointers and int have 4 bytes in wasm32, others 8."""
    folder = template_folder()
    header = (plain_c_folder(folder) / "run.h").read_text(encoding="utf-8")
    settings = {name: name == "WITH_PROFILE" for name in re.findall(r"WITH_\w+", header)}
    text = paste_text(header, {}, settings, "double", "")
    body = text[text.index("long long n_accepted") : text.index("} scene_run;")]
    end = 0
    for field in re.sub(r"/\*.*?\*/", "", body, flags=re.S).split(";")[:-1]:
        size = 4 if "*" in field or field.split()[0] == "int" else 8
        end = -(-end // size) * size + size * (1 + field.count(","))
    worker = (folder / "live" / "worker.js").read_text(encoding="utf-8")
    reserved = re.search(r"^const RUN = (\d+);", worker, re.M)
    assert reserved is not None
    assert 0 < end <= 8 * int(reserved[1])


def test_a_page_has_surfaces_of_bodies_and_neither_corners_nor_edges() -> None:
    structure = load_scene(RODS)[0]
    assert isinstance(structure, Structure)
    scene = build_live_scene(structure)
    assert scene.headline == "2 bodies, 4 nodes, 2 cables; not in balance at rod"
    assert scene.data["shown"] == 4
    assert scene.data["members"] == ("line", "tie")
    first, place, triangle = (
        unpack(scene.channels[f"body_{name}"]) for name in ("first", "place", "triangle")
    )
    mesh = build_mesh(structure.bodies)
    np.testing.assert_array_equal(first, mesh.first)
    np.testing.assert_allclose(place, mesh.place, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(triangle, mesh.triangle)
    assert unpack(scene.channels["strand_of"]).tolist() == [0, 1]
