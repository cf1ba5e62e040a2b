"""MJCF: the same masses, forces and motions as the structure, in MuJoCo and in plain arithmetic."""

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen import compile_scene, load_scene, simulate
from tensegrity_codegen.export.export_mjcf import build_mjcf
from tensegrity_codegen.export.exporter import ExportSource, write_export
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, UnknownNameError
from tests.cli.conftest import write_example
from tests.ground_cases import make_prism, make_slope
from tests.rigid_scenes import HANGING as RODS
from tests.runtime.integrate.test_ground import rotate

FloatArray = NDArray[np.float64]

# Bars with own mass in a ring and a chain, held on some axes; cables; a planar one; moved far away.
NODES: dict[str, dict[str, Any]] = {
    "a": {"position": [0.0, 0.0, 0.0], "anchored": "z", "mass": 0.2},
    "b": {"position": [1.0, 0.0, 0.1], "mass": 0.1, "velocity": [0.1, 0.2, -0.1]},
    "c": {"position": [0.5, 0.9, 0.4]},
    "d": {"position": [0.4, 0.3, 1.1], "velocity": [0.0, 0.3, 0.0]},
    "e": {"position": [0.0, 0.0, 1.5], "anchored": True},
}
MEMBERS: dict[str, dict[str, Any]] = {
    "ab": {"kind": "bar", "nodes": ["a", "b"], "spring_constant": 4e3, "mass": 0.3},
    "bc": {"kind": "bar", "nodes": ["c", "b"], "axial_stiffness": 4e3, "mass": 0.4, "damping": 2.0},
    "ca": {"kind": "bar", "nodes": ["c", "a"], "spring_constant": 3e3, "mass": 0.5},
    "cd": {"kind": "bar", "nodes": ["c", "d"], "spring_constant": 5e3, "mass": 0.25},
    "de": {"kind": "bar", "nodes": ["d", "e"], "spring_constant": 2e3, "mass": 0.6},
    "ad": {"kind": "cable", "nodes": ["a", "d"], "spring_constant": 200.0, "prestress": 5.0},
    "be": {"kind": "cable", "nodes": ["b", "e"], "axial_stiffness": 300.0, "rest_length": 3.0},
}


def build_scene(**changes: Any) -> dict[str, Any]:
    loads = [{"node": "b", "force": [1.0, 2.0, -1.0]}]
    scene = {"name": "ring", "gravity": [0.3, 0, -9.81], "nodes": NODES, "members": MEMBERS, "loads": loads}
    return {**scene, **changes}


def build(scene: dict[str, Any]) -> Structure:
    structure, _ = load_scene(scene)
    assert isinstance(structure, Structure)
    return structure


def list_joints(root: Element) -> list[tuple[str, str]]:
    """Return body and axis of each slide joint, in the order of the file."""
    letters = {"1 0 0": "x", "0 1 0": "y", "0 0 1": "z"}
    return [
        (body.get("name", ""), letters[joint.get("axis", "")])
        for body in root.iter("body")
        for joint in body.findall("joint")
    ]


def compute_kinetic_energy(root: Element, rate: FloatArray) -> float:
    """Return the kinetic energy [J] of a model of points for the rates of its joints, and their speeds."""
    joints = list_joints(root)
    by_name = {f"{body}.{axis}": value for (body, axis), value in zip(joints, rate, strict=True)}
    energy = 0.0

    def visit(body: Element, speed: FloatArray) -> None:
        nonlocal energy
        own = np.array([by_name.get(f"{body.get('name')}.{axis}", 0.0) for axis in "xyz"])
        inertial = body.find("inertial")
        if inertial is not None:
            energy += 0.5 * float(inertial.get("mass", "")) * float((speed + own) @ (speed + own))
        for child in body.findall("body"):
            visit(child, speed + own)

    world = root.find("worldbody")
    assert world is not None
    for body in world.findall("body"):
        visit(body, np.zeros(3))
    for tendon in root.iter("fixed"):
        turned = sum(float(j.get("coef", "")) * by_name[j.get("joint", "")] for j in tendon.findall("joint"))
        energy += 0.5 * float(tendon.get("armature", "")) * turned**2
    return energy


def find_speeds(root: Element, structure: Structure, rate: FloatArray) -> FloatArray:
    """Return the velocities of the nodes (n_nodes, 3) for the rates of the joints."""
    by_name = {f"{b}.{a}": v for (b, a), v in zip(list_joints(root), rate, strict=True)}
    speeds = np.zeros((structure.n_nodes, 3))

    def visit(body: Element, speed: FloatArray) -> None:
        own = speed + [by_name.get(f"{body.get('name')}.{axis}", 0.0) for axis in "xyz"]
        speeds[structure.node_name.index(body.get("name", ""))] = own
        for child in body.findall("body"):
            visit(child, own)

    for body in root.findall("worldbody/body"):
        visit(body, np.zeros(3))
    return speeds


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"nodes": {k: {**v, "position": [x + 1000 for x in v["position"]]} for k, v in NODES.items()}},
        {"nodes": dict(reversed(NODES.items())), "members": dict(reversed(MEMBERS.items()))},
        {"nodes": {k: {**v, "anchored": k == "c"} for k, v in NODES.items()}},
    ],
)
def test_the_kinetic_energy_is_that_of_nodes_and_bars(changes: dict[str, Any]) -> None:
    structure = build(build_scene(**changes))
    root, notes = build_mjcf(structure)
    assert not any("half at each end" in note for note in notes)
    rng = np.random.default_rng(3)
    for _ in range(5):
        rate = rng.normal(size=len(list_joints(root)))
        v = find_speeds(root, structure, rate)
        wanted = 0.5 * float(structure.node_mass @ (v**2).sum(axis=1))
        for (i, j), mass in zip(structure.connectivity, structure.member_mass, strict=True):
            wanted += mass / 6 * float(v[i] @ v[i] + v[i] @ v[j] + v[j] @ v[j])
        assert compute_kinetic_energy(root, rate) == pytest.approx(wanted, rel=1e-12)


def test_bars_that_the_tree_cannot_couple_are_lumped_and_listed() -> None:
    nodes = {**NODES, "d": {**NODES["d"], "anchored": "x"}}  # beside a, which is held along z
    structure = build(build_scene(nodes=nodes))
    root, notes = build_mjcf(structure)
    (note,) = (note for note in notes if "half at each end" in note)
    lumped = [name for name in structure.member_name if f" {name} " in note]
    assert len(lumped) == 1
    rate = np.random.default_rng(3).normal(size=len(list_joints(root)))
    v = find_speeds(root, structure, rate)
    wanted = 0.5 * float(structure.node_mass @ (v**2).sum(axis=1))
    members = zip(structure.member_name, structure.connectivity, structure.member_mass, strict=True)
    for name, (i, j), mass in members:
        if name in lumped:
            wanted += mass / 4 * float(v[i] @ v[i] + v[j] @ v[j])
        else:
            wanted += mass / 6 * float(v[i] @ v[i] + v[i] @ v[j] + v[j] @ v[j])
    assert compute_kinetic_energy(root, rate) == pytest.approx(wanted, rel=1e-12)


def test_what_mujoco_cannot_express_is_refused_by_name() -> None:
    rigid = {"kind": "bar", "mass": 0.1}
    meeting = {"p": {**rigid, "nodes": ["a", "b"]}, "q": {**rigid, "nodes": ["b", "c"]}}
    light = {name: {k: v for k, v in node.items() if k != "mass"} for name, node in NODES.items()}
    cables = {name: member for name, member in MEMBERS.items() if member["kind"] == "cable"}
    others = {name: MEMBERS[name] for name in ("ca", "cd", "ad", "be")}
    for scene, word in (
        (build_scene(members={**others, **meeting}), "share a node"),
        (build_scene(members={**others, "p": meeting["p"]}), "some axes"),
        (build_scene(nodes=light, members={**cables, "cd": {**MEMBERS["cd"], "mass": None}}), "no mass"),
    ):
        with pytest.raises(FormulationError, match=word):
            build_mjcf(build(scene))
    for step in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InvalidValueError):
            build_mjcf(build(build_scene()), step)
    with pytest.raises(UnknownNameError):
        build_mjcf(build(build_scene()), integrator="RK5")


def test_a_scene_of_bodies_is_refused(tmp_path: Path) -> None:
    path = write_example(tmp_path, "svd_tower")
    with pytest.raises(FormulationError, match="scenes of bodies"):
        write_export("mjcf", ExportSource(path, *load_scene(path)), tmp_path / "out.xml")
    assert not (tmp_path / "out.xml").exists()


def test_a_rigid_body_is_a_body_with_inertia_parts_and_points() -> None:
    structure = build({**RODS, "ground": {"stiffness": 1e4, "contacts": ["rod.foot"]}})
    root, notes = build_mjcf(structure)
    text = tostring(root, encoding="unicode")
    assert "corner" not in text
    assert "edge" not in text
    block = next(body for body in root.iter("body") if body.get("name") == "block")
    inertial, geom, site = block.find("inertial"), block.find("geom"), block.find("site")
    assert inertial is not None
    assert geom is not None
    assert site is not None
    assert inertial.get("fullinertia") == "0.0004 0.0005 0.0006 1e-05 0.0 0.0"
    assert (inertial.get("mass"), inertial.get("pos")) == ("0.5", "0.0 0.01 0.0")
    assert (geom.get("type"), geom.get("size"), geom.get("mass")) == ("box", "0.03 0.02 0.025", "0")
    assert (site.get("name"), site.get("pos")) == ("block_eye", "0.0 0.0 0.03")
    rod = next(body for body in root.iter("body") if body.get("name") == "rod")
    assert [geom.get("type") for geom in rod.findall("geom")] == ["cylinder", "sphere", "sphere"]
    assert [g.get("name") for g in rod.findall("geom")] == [None, None, "rod_foot.foot"]
    assert not [note for note in notes if "edge" in note or "corner" in note]


def test_a_rigid_bar_on_a_body_is_refused() -> None:
    bar = {"kind": "bar", "nodes": ["rod.foot", "block.eye"]}
    with pytest.raises(FormulationError, match="share a node") as caught:
        build_mjcf(build({**RODS, "members": {**RODS["members"], "stick": bar}}))
    assert "rod_foot" in str(caught.value.given)


# --- in MuJoCo -------------------------------------------------------------------------------------


def run_mujoco(structure: Structure, step: float, count: int, spacing: float) -> FloatArray:
    """Return the node positions (count, n_nodes, 3) of the exported model, `spacing` [s] apart."""
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    model = mujoco.MjModel.from_xml_string(tostring(build_mjcf(structure)[0], encoding="unicode"))
    data = mujoco.MjData(model)
    sites = [
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name) for name in hide_bodies(structure).node_name
    ]
    model.opt.timestep = step
    mujoco.mj_resetDataKeyframe(model, data, 0)
    places = []
    for index in range(count):
        if index:
            mujoco.mj_step(model, data, nstep=round(spacing / step))
        mujoco.mj_kinematics(model, data)
        places.append(data.site_xpos[sites].copy())
    return np.array(places)


@pytest.mark.peers
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "step", "bound"), [("prism", 1e-4, 1e-6), ("icosahedron", 5e-5, 1e-8), ("tower", 2.5e-5, 1e-8)]
)
def test_the_motions_of_the_examples_converge_to_ours(
    name: str, step: float, bound: float, tmp_path: Path
) -> None:
    """One second in MuJoCo's RK4, in steps that resolve the vibration of the bars: order 4."""
    path = write_example(tmp_path, name)
    model = compile_scene(path, for_="simulate", method="rk853")
    own = simulate(model, t_end=1.0, samples=11, method="rk853", rtol=1e-10)
    assert isinstance(model.structure, Structure)
    errors = [
        float(np.abs(run_mujoco(model.structure, each, 11, 0.1) - own.node_position).max())
        for each in (2 * step, step)
    ]
    assert errors[0] / errors[1] > 7, errors
    assert errors[1] < bound, errors


@pytest.mark.peers
@pytest.mark.parametrize("moved", [0.0, 1000.0])
def test_a_ring_of_heavy_bars_moves_as_ours(moved: float) -> None:
    nodes = {k: {**v, "position": [x + moved for x in v["position"]]} for k, v in NODES.items()}
    model = compile_scene(build_scene(nodes=nodes), for_="simulate", method="rk853")
    own = simulate(model, t_end=0.2, samples=3, method="rk853", rtol=1e-9)
    assert isinstance(model.structure, Structure)
    found = run_mujoco(model.structure, 1e-4, 3, 0.1)
    assert np.abs(found - own.node_position).max() < 1e-7


@pytest.mark.peers
def test_rigid_bars_move_as_ours() -> None:
    """A pendulum on an anchored end and a free bar, joined by springs."""
    rigid = {"kind": "bar", "mass": 0.4}
    scene = {
        "name": "sticks",
        "gravity": [0, 0, -9.81],
        "model": {"formulation": "rigid_bar"},
        "nodes": {
            "top": {"position": [0, 0, 0], "anchored": True},
            "low": {"position": [0.3, 0.1, -0.9], "mass": 0.2, "velocity": [0.0, 0.9, 0.1]},
            "left": {"position": [0.5, 0.6, -0.2], "mass": 0.1, "velocity": [0.1, 0.0, 0.0]},
            "right": {"position": [0.9, 0.9, -0.8], "velocity": [0.1, 0.0, 0.0]},
        },
        "members": {
            "pendulum": {**rigid, "nodes": ["top", "low"]},
            "stick": {**rigid, "nodes": ["left", "right"]},
            "s1": {"kind": "cable", "nodes": ["low", "right"], "spring_constant": 60, "rest_length": 0.7},
            "s2": {"kind": "cable", "nodes": ["top", "left"], "spring_constant": 90, "rest_length": 0.6},
        },
    }
    speed = np.cross([0.3, 0.1, -0.9], [0.0, 0.9, 0.1])  # across the pendulum
    turned = np.cross(speed, [0.3, 0.1, -0.9]) / np.dot([0.3, 0.1, -0.9], [0.3, 0.1, -0.9])
    scene["nodes"]["low"]["velocity"] = turned.tolist()  # type: ignore[index]
    model = compile_scene(scene, for_="simulate", method="rk853")
    own = simulate(model, t_end=0.5, samples=6, method="rk853", rtol=1e-9)
    assert isinstance(model.structure, Structure)
    errors = [
        float(np.abs(run_mujoco(model.structure, step, 6, 0.1) - own.node_position).max())
        for step in (5e-4, 1e-4)
    ]
    assert errors[1] < min(errors[0] / 3, 5e-7), errors  # cables go slack, which costs order


def test_the_ground_is_a_plane_that_the_feet_alone_touch() -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    root, notes = build_mjcf(prism)
    geoms = {geom.get("name"): geom for geom in root.iter("geom")}
    assert set(geoms) == {"ground", *(f"{name}.foot" for name in prism.contact_name)}
    ground = geoms.pop("ground")
    assert (ground.get("type"), ground.get("friction")) == ("plane", "0.5 0 0")
    pairs = [(int(geom.get("contype", "")), int(geom.get("conaffinity", ""))) for geom in geoms.values()]
    assert not any(first & other for first, _ in pairs for _, other in pairs)
    assert all(int(ground.get("contype", "")) & affinity for _, affinity in pairs)
    assert any("contact law" in note for note in notes)
    assert not list(build_mjcf(prism.with_changes(ground=None))[0].iter("geom"))


def test_mujoco_lets_a_block_fall_stick_and_slip() -> None:
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    for angle, far in ((20.0, 0.05), (30.0, 2.0)):
        slope, down = make_slope(np.radians(angle))
        model = mujoco.MjModel.from_xml_string(tostring(build_mjcf(slope, 1e-3)[0], encoding="unicode"))
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_step(model, data, nstep=2000)
        place = data.site(slope.contact_name[0]).xpos
        assert abs(place @ slope.ground.normal) < 1e-3
        assert 0.3 * far < place @ down < far if angle > 26.6 else 0.0 <= place @ down < far


@pytest.mark.peers
def test_rigid_bodies_move_as_ours() -> None:
    """Masses and inertias are MuJoCo's too, and motions with a spin agree to the order of its steps."""
    mujoco = pytest.importorskip("mujoco", reason="needs the package mujoco")
    model = compile_scene(RODS, for_="simulate", method="rk853")
    own = simulate(model, t_end=0.5, samples=6, method="rk853", rtol=1e-10)
    structure = model.structure
    assert isinstance(structure, Structure)
    foreign = mujoco.MjModel.from_xml_string(tostring(build_mjcf(structure)[0], encoding="unicode"))
    for k, body in enumerate(structure.bodies, start=1):
        assert foreign.body_mass[k] == pytest.approx(body.mass, rel=1e-14)
        principal = np.linalg.eigvalsh(body.inertia)
        np.testing.assert_allclose(np.sort(foreign.body_inertia[k]), principal, rtol=1e-9)
    count = len(own.node_name) - 8  # without corners, which MuJoCo does not know
    errors = [
        float(np.abs(run_mujoco(structure, step, 6, 0.1) - own.node_position[:, :count]).max())
        for step in (5e-4, 1e-4)
    ]
    assert errors[1] < min(errors[0] / 3, 5e-7), errors  # cables go slack, which costs order
