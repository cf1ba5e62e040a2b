"""Units in fmpy: no message of its validation, and the motions of `simulate`, in both versions and kinds."""

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tests.cases import thorough
from tests.export.scenes import write_loose

pytestmark = pytest.mark.peers
fmpy = pytest.importorskip("fmpy", reason="needs fmpy: pip install '.[fmu]'")

EXAMPLES = files("tensegrity_codegen.scene").joinpath("examples")
RTOL, T_END = 1e-8, 0.5
KINDS = {"me": "ModelExchange", "cs": "CoSimulation"}


def find_scene(name: str, folder: Path) -> Path:
    if name == "loose":
        return write_loose(folder)
    path = folder / f"{name}.toml"
    path.write_text(EXAMPLES.joinpath(f"{name}.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return path


def validate(path: Path) -> list[str]:
    from fmpy.validation import validate_fmu

    return list(validate_fmu(str(path)))


def run(path: Path, kind: str, **options: Any) -> Any:
    return fmpy.simulate_fmu(
        str(path),
        fmi_type=KINDS[kind],
        stop_time=T_END,
        output_interval=0.01,
        relative_tolerance=RTOL,
        **options,
    )


def largest_error(found: Any, ours: Trajectory) -> float:
    """Return the largest difference of a node position [m]."""
    rows = np.searchsorted(found["time"], ours.time - 1e-9)
    return max(
        float(
            np.abs(
                found[f"node_position.{name}.{axis}"][rows] - ours.node_position[:, k, "xyz".index(axis)]
            ).max()
        )
        for k, name in enumerate(ours.node_name)
        for axis in "xyz"
        if f"node_position.{name}.{axis}" in found.dtype.names
    )


# Bodies; damping, inputs and parameters; free, with inputs; planar; bars of constant length are below.
NAMES = ["loose", *thorough("tower", "svd_tower", "prism12", "planar", "two_nodes")]


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("name", NAMES)
def test_the_motion_is_that_of_simulate(name: str, fmi: str, tmp_path: Path) -> None:
    scene, out = find_scene(name, tmp_path), tmp_path / "unit.fmu"
    exported = export_fmu(scene, out, fmi=fmi)
    assert exported.facts["has_derivatives"]
    assert validate(out) == []
    ours = simulate(compile_scene(scene, for_="simulate"), T_END, samples=51, rtol=RTOL)
    assert ours.status == "ok"
    by_steps, by_states = run(out, "cs"), run(out, "me")
    assert largest_error(by_steps, ours) < 100 * RTOL
    assert largest_error(by_states, ours) < 1e4 * RTOL  # of fmpy's own integrator, of order 5 or less
    assert by_steps["event_count"][-1] == ours.log.count
    # A cable that starts at its rest length goes taut at once; its margin has no sign before: no state event.
    assert by_states["event_count"][-1] == np.count_nonzero(ours.log.time > 1e-6)
    if name == "loose":
        assert ours.log.count > 3
        assert by_steps["is_slack.vertical2"].astype(bool).any()


@pytest.mark.parametrize("kind", ["me", "cs"])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_a_unit_of_one_kind_has_only_that(kind: str, fmi: str, tmp_path: Path) -> None:
    out = tmp_path / "unit.fmu"
    export_fmu(find_scene("two_nodes", tmp_path), out, fmi=fmi, kind=kind)
    assert validate(out) == []
    description = fmpy.read_model_description(str(out))
    assert (description.modelExchange is not None) == (kind == "me")
    assert (description.coSimulation is not None) == (kind == "cs")
    assert len(run(out, kind)) > 10


def test_inputs_over_time_and_start_values(tmp_path: Path) -> None:
    scene, out = find_scene("loose", tmp_path), tmp_path / "unit.fmu"
    export_fmu(scene, out, fmi="3.0")
    time = np.linspace(0.0, T_END, 6)
    table = np.array(
        list(zip(time, 0.01 * (time > 0.15), strict=True)), dtype=[("time", float), ("input.winch", float)]
    )
    plain, driven = run(out, "cs"), run(out, "cs", input=table)
    lighter = run(out, "cs", start_values={"gravity.z": -1.0})
    assert np.abs(driven["node_position.t1.z"] - plain["node_position.t1.z"]).max() > 1e-4
    assert np.abs(lighter["node_position.t1.z"] - plain["node_position.t1.z"]).max() > 1e-4


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_sources_alone_make_the_same_unit(fmi: str, tmp_path: Path) -> None:
    build = pytest.importorskip("fmpy.build", reason="needs fmpy with its builder: pip install '.[fmu]'")
    if not has_cmake():
        pytest.skip("needs cmake: pip install cmake")
    scene, out, bare = find_scene("loose", tmp_path), tmp_path / "whole.fmu", tmp_path / "bare.fmu"
    export_fmu(scene, out, fmi=fmi)
    assert export_fmu(scene, bare, fmi=fmi, sources_only=True).facts["binaries"] == []
    folder, work = tmp_path / "unzipped", tmp_path / "build"
    work.mkdir()
    fmpy.extract(str(bare), str(folder))
    build.build_platform_binary(folder, work)
    whole = run(out, "cs")
    again = run(folder, "cs")
    assert np.abs(again["node_position.t1.z"] - whole["node_position.t1.z"]).max() < 100 * RTOL


def has_cmake() -> bool:
    import shutil

    return shutil.which("cmake") is not None
