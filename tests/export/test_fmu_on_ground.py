"""Units of structures on the ground: their states, events, derivatives, beside `simulate`."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.system.errors import FormulationError
from tests.cases import thorough
from tests.export.importer import Unit2

DROPPED = """
name = "dropped"
gravity = [0.3, 0, -9.81]

[model]
quantities = ["contact_force"]
formulation = "{formulation}"
options = {options}

[parameters]
ground = ["friction"]

[classes.bar]
kind = "bar"
spring_constant = 2e4
mass = 0.05

[classes.cable]
kind = "cable"
spring_constant = 200

[shape]
kind = "prism"
bars = 3
bottom_radius = 0.15
height = 0.30
node_mass = 0.05
prestress = 1.0

[ground]
offset = -0.02
stiffness = 2e4
dissipation = 0.3
friction = 0.2
{more}
"""
T_END, RTOL = 0.12, 1e-9


def write_scene(folder: Path, formulation: str = "node_position", more: str = "") -> Path:
    path = folder / "dropped.toml"
    options = '{ bars = "all" }' if formulation == "rigid_bar" else "{}"
    path.write_text(DROPPED.format(formulation=formulation, options=options, more=more), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("formulation", "method"),
    [("node_position", "rk853"), *thorough(("rigid_bar", "rk853"), ("node_position", "radau"))],
)
def test_communication_steps_follow_simulate(tmp_path: Path, formulation: str, method: str) -> None:
    scene = write_scene(tmp_path, formulation)
    export_fmu(scene, tmp_path / "unit.fmu", method=method)
    unit = Unit2(tmp_path / "unit.fmu", tmp_path / "unit", "cs")
    assert unit.set_all({"ground.friction": 0.3}) == 0
    unit.start(RTOL)
    for k in range(40):
        assert unit.step(k * T_END / 40, T_END / 40) == 0, unit.messages
    model = compile_scene(scene, for_="simulate")
    ours = simulate(model, T_END, samples=41, method="rk853", rtol=RTOL, arguments={"ground": [0.3]})
    names = [f"node_position.{node}.{axis}" for node in ours.node_name for axis in "xyz"]
    assert np.abs(unit.get(*names).reshape(-1, 3) - ours.node_position[-1]).max() < 1e-8
    bristles = [name for name in ours.internal_name if "_stick" in name]  # behind them are energies
    assert bristles == list(ours.internal_name[: len(bristles)])
    internal = unit.get(*(f"internal.{name}" for name in bristles))
    assert ours.internal is not None
    assert np.abs(internal - ours.internal[-1, : len(bristles)]).max() < 1e-8
    kinds = set(ours.log.kind)
    assert {"ground", "stick"} <= kinds
    assert unit.count() == ours.log.count
    said = [text.rpartition(" at t =")[0] for status, text in unit.messages if status == 0]
    words = {
        ("ground", 1): "touches the ground",
        ("ground", -1): "leaves the ground",
        ("stick", 1): "sticks",
        ("stick", -1): "slips",
        ("cable", 1): "goes taut",
        ("cable", -1): "goes slack",
    }
    log = zip(ours.log.name, ours.log.kind, ours.log.direction.tolist(), strict=True)
    assert sorted(said) == sorted(f"{name} {words[kind, way]}" for name, kind, way in log)
    for node in ours.node_name:
        pressed = np.abs(unit.get(*(f"contact_force.{node}.{axis}" for axis in "xyz"))).max() > 0
        assert unit.flag(f"is_lifted.{node}") == (not pressed)
    unit.free()


def test_model_exchange_follows_simulate(tmp_path: Path) -> None:
    scene = write_scene(tmp_path)
    export_fmu(scene, tmp_path / "unit.fmu", kind="me", method="rk853")
    unit = Unit2(tmp_path / "unit.fmu", tmp_path / "unit", "me")
    unit.start(RTOL)
    n_margins = 9 + 6 + 6
    assert int(unit.description.get("numberOfEventIndicators") or 0) == n_margins
    unit.integrate(0.08, 36 + 12, n_margins, RTOL)
    ours = simulate(compile_scene(scene, for_="simulate"), 0.08, method="rk853", rtol=RTOL)
    names = [f"node_position.{node}.{axis}" for node in ours.node_name for axis in "xyz"]
    assert np.abs(unit.get(*names).reshape(-1, 3) - ours.node_position[-1]).max() < 1e-7
    unit.free()


def test_derivatives_are_those_of_differences(tmp_path: Path) -> None:
    export_fmu(write_scene(tmp_path), tmp_path / "unit.fmu", kind="me", method="rk853")
    unit, other = (Unit2(tmp_path / "unit.fmu", tmp_path / name, "me") for name in ("one", "two"))
    start = {"coordinate.b1_z": -0.0201, "velocity.b1_x": 0.05, "velocity.b1_y": 0.02}
    knowns = [*start, "internal.b1_stick1", "ground.friction"]
    assert unit.set_all(start) == 0
    unit.start()
    unknowns = [name for name in unit.reference if name.startswith(("der(", "contact_force.b1."))]
    seed = np.array([1e-3, -0.7, 0.3, 2e-5, 0.5])
    found, values, at = unit.derivative(unknowns, knowns, list(seed)), [], unit.get(*knowns)
    for sign in (1.0, -1.0):
        other.good("Reset")
        assert other.set_all(dict(zip(knowns, at + sign * 1e-5 * seed, strict=True))) == 0
        other.start()
        values.append(other.get(*unknowns))
    differences = (values[0] - values[1]) / 2e-5
    rates = [k for k, name in enumerate(unknowns) if name.startswith("der(internal.b1")]
    assert np.abs(found[rates]).min() > 1e-3
    for rows in (rates, [k for k in range(len(unknowns)) if k not in rates]):
        assert np.abs(found[rows] - differences[rows]).max() < 1e-5 * np.abs(found[rows]).max()
    unit.free()
    other.free()


def test_friction_whose_states_jump_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormulationError, match="static_friction"):
        export_fmu(write_scene(tmp_path, more="static_friction = 0.4"), tmp_path / "unit.fmu")
    assert not (tmp_path / "unit.fmu").exists()
