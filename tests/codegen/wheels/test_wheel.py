"""A wheel of a library, installed where NumPy alone is installed, computes what the library computes."""

import base64
import csv
import hashlib
import importlib.metadata
import io
import json
import subprocess
import sys
import sysconfig
import venv
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.wheels import bundled
from tensegrity_codegen.codegen.wheels.wheel import (
    build_wheel,
    check_wheel,
    name_distribution,
    wheel_file_name,
)
from tensegrity_codegen.pipeline.build_library import BuiltLibrary, build_library
from tensegrity_codegen.system.errors import FormulationError, InvalidNameError
from tensegrity_codegen.tables.manifest import SOLVER_STATUS, STATUS
from tensegrity_codegen.tables.request import ModelRequest
from tensegrity_codegen.tables.targets import TARGETS, Target, find_target
from tests.codegen.subjects import everything
from tests.comparison import dense
from tests.runtime.build import prism

QUANTITIES = ("member_tension", "tangent_stiffness", "potential_energy", "acceleration", "node_residual")
REQUEST = ModelRequest(QUANTITIES, integrators=("rk4", "rk853", "radau"), solvers=("equilibrium",))

# Calls every function at values near those of the scene; prints JSON.
SCRIPT = """
import json, sys
import numpy as np
import {package} as made
found = {{}}
for name in made.__all__:
    if name.startswith("compute_"):
        result = getattr(made, name)()
        found[name] = np.asarray(result.to_dense() if hasattr(result, "to_dense") else result).tolist()
found["modules"] = sorted({{module.partition(".")[0] for module in sys.modules}})
{more}
print(json.dumps(found))
"""
MORE = """
q = made.nominal("coordinate")
q = q + 0.01 * np.sin(np.arange(q.size))
found["moved"] = made.compute_member_tension(q).tolist()
motion = made.integrate_rk4(1e-4, 20, coordinate=q)
found["rk4"] = [motion.time.tolist(), motion.coordinate.tolist(), motion.n_steps]
motion = made.integrate_rk853(0.01, rtol=1e-9, atol=1e-11, sample_time=[0.0, 0.01], coordinate=q)
found["rk853"] = motion.coordinate[-1].tolist()
motion = made.integrate_radau(0.01, rtol=1e-9, atol=1e-11, sample_time=[0.0, 0.01], coordinate=q)
found["repr"] = repr(motion)
found["radau"] = motion.coordinate[-1].tolist()
start = made.nominal("coordinate")
found["names"] = [made.NODE_NAMES, made.MEMBER_NAMES, made.CONNECTIVITY.tolist()]
errors = {}
def note(what, function, *words, **named):
    try:
        function(*words, **named)
    except Exception as error:
        errors[what] = [type(error).__name__, str(error)]
note("shape", made.compute_member_tension, q[:-1])
note("text", made.compute_member_tension, "many")
note("nan", made.compute_member_tension, q * np.nan)
note("steps", made.integrate_rk4, -1.0, 10, [0.0])
note("few", made.integrate_rk853, 1.0, most_steps=3)
note("unsorted", made.integrate_rk853, 1.0, sample_time=[1.0, 0.0])
note("end", made.find_equilibrium, most_iterations=0, coordinate=q)
found["errors"] = errors
found["help"] = made.compute_member_tension.__doc__
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a new environment that has NumPy, linked from this one, and nothing else."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    scripts = folder / ("Scripts" if sys.platform == "win32" else "bin")
    python = scripts / Path(sys.executable).with_stem("python").name
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    for path in importlib.metadata.files("numpy") or ():
        top = Path(path.parts[0])
        if not (site / top).exists() and ".." not in path.parts:
            (site / top).symlink_to(Path(str(path.locate())).parents[len(path.parts) - 1] / top)
    return python


def run(*command: Any, folder: Path | None = None) -> str:
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def install(python: Path, built: BuiltLibrary, folder: Path) -> Path:
    """Write the wheel of a library and install it."""
    exported = built.export(folder / "library", wheel=True)
    wheel = exported / wheel_file_name(built.manifest)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python, "install")
    run(*pip, "--no-index", "--force-reinstall", "--no-deps", wheel)
    run(sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", python, "check")
    return wheel


def call(python: Path, package: str, folder: Path, more: str = "") -> dict[str, Any]:
    script = folder / "script.py"
    script.write_text(SCRIPT.format(package=package, more=more), encoding="utf-8")
    found: dict[str, Any] = json.loads(run(python, "-W", "error", script, folder=folder))
    return found


@pytest.fixture(scope="module")
def built() -> BuiltLibrary:
    return build_library(prism().with_changes(name="Small_prism"), REQUEST)


@pytest.fixture(scope="module")
def found(python: Path, built: BuiltLibrary, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("wheel")
    install(python, built, folder)
    return call(python, "tensegrity_Small_prism", folder, MORE)


def moved(built: BuiltLibrary) -> Any:
    q = built.load().nominal("coordinate")
    return q + 0.01 * np.sin(np.arange(q.size))


def test_every_function_gives_the_numbers_of_the_library(built: BuiltLibrary, found: dict[str, Any]) -> None:
    model = built.load()
    for spec in built.manifest.functions:
        expected = dense(model.compute(spec.quantity))
        np.testing.assert_array_equal(np.array(found[f"compute_{spec.quantity}"]), expected)
    np.testing.assert_array_equal(found["moved"], model.compute("member_tension", coordinate=moved(built)))


def test_the_package_loads_numpy_and_no_other_package(found: dict[str, Any]) -> None:
    missing = {"tensegrity_codegen", "cffi", "casadi", "scipy"} & set(found["modules"])
    assert missing == set()
    assert "numpy" in found["modules"]


def test_methods_agree_with_each_other(found: dict[str, Any]) -> None:
    times, coordinates, n_steps = found["rk4"]
    assert n_steps == 20
    assert len(times) == len(coordinates) == 21
    np.testing.assert_allclose(found["rk853"], found["radau"], rtol=0, atol=1e-7)


def test_names_come_with_the_package(built: BuiltLibrary, found: dict[str, Any]) -> None:
    manifest = built.manifest
    assert found["names"] == [
        [*manifest.node_name],
        [*manifest.member_name],
        [list(pair) for pair in manifest.connectivity],
    ]
    assert "Parameters" in found["help"]
    assert f"member_tension : ({len(manifest.member_name)},) [N]" in found["help"]


def test_every_wrong_call_is_an_error_with_a_reason(found: dict[str, Any]) -> None:
    errors = found["errors"]
    assert {what: error[0] for what, error in errors.items()} == {
        "shape": "ValueError",
        "text": "ValueError",
        "nan": "NonFiniteInputError",
        "steps": "InvalidArgumentError",
        "few": "NotConvergedError",
        "unsorted": "ValueError",
        "end": "NotConvergedError",
    }
    assert "coordinate" in errors["shape"][1]
    assert "Small_prism_compute_member_tension" in errors["nan"][1]
    assert "3 steps reach" in errors["few"][1]


def test_errors_follow_the_statuses_of_the_library() -> None:
    names = [error.__name__.removesuffix("Error").lower() for error in bundled.STATUS_ERRORS]
    statuses = [word.replace("_", "") for word in (*STATUS[1:], *SOLVER_STATUS)]
    plain = [name if name != "status" else "nullpointer" for name in names]
    assert plain == statuses


@pytest.mark.thorough
@pytest.mark.parametrize("precision", ["double", "single"])
def test_a_structure_with_everything_has_a_package(python: Path, precision: str, tmp_path: Path) -> None:
    structure, request = everything()
    if precision == "single":
        few = request.wanting("acceleration", "member_tension", integrators=("rk4", "rk853"))
        request = replace(few, precision=precision)
    built = build_library(structure, request)
    install(python, built, tmp_path)
    found = call(python, "tensegrity_braced", tmp_path)
    model = built.load()
    for spec in built.manifest.functions:
        expected = dense(model.compute(spec.quantity))
        np.testing.assert_array_equal(np.array(found[f"compute_{spec.quantity}"], expected.dtype), expected)


def unpack(wheel: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(wheel)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def test_the_record_lists_every_file_with_its_hash(built: BuiltLibrary) -> None:
    name, wheel = build_wheel(built.manifest, built.path)
    files = unpack(wheel)
    (record,) = (path for path in files if path.endswith("/RECORD"))
    rows = {row[0]: row[1:] for row in csv.reader(files[record].decode("utf-8").splitlines())}
    assert rows.keys() == files.keys()
    for path, (digest, size) in rows.items():
        if path != record:
            expected = (
                base64.urlsafe_b64encode(hashlib.sha256(files[path]).digest()).decode("ascii").rstrip("=")
            )
            assert (digest, int(size)) == (f"sha256={expected}", len(files[path]))
    assert build_wheel(built.manifest, built.path) == (name, wheel)
    assert any(path.endswith("/py.typed") for path in files)


def test_the_platform_tag_is_that_of_this_machine(built: BuiltLibrary) -> None:
    tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    name, wheel = build_wheel(built.manifest, built.path)
    assert name.endswith(f"-py3-none-{tag}.whl")
    (text,) = (data for path, data in unpack(wheel).items() if path.endswith("/WHEEL"))
    assert f"Tag: py3-none-{tag}\n" in text.decode("utf-8")


@pytest.mark.parametrize(
    "target", [target for target in TARGETS.values() if target.wheel_tag], ids=lambda t: t.name
)
def test_the_platform_tag_is_that_of_the_target(target: Target, built: BuiltLibrary) -> None:
    name, wheel = build_wheel(replace(built.manifest, target=target.name), built.path)
    assert name.endswith(f"-py3-none-{target.wheel_tag}.whl")
    (text,) = (data for path, data in unpack(wheel).items() if path.endswith("/WHEEL"))
    tags = [line for line in text.decode("utf-8").splitlines() if line.startswith("Tag: ")]
    assert tags == [f"Tag: py3-none-{part}" for part in target.wheel_tag.split(".")]


@pytest.mark.parametrize("name", ["wasm32", "thumbv7em"])
def test_what_python_cannot_load_has_no_wheel(name: str) -> None:
    with pytest.raises(FormulationError, match="not a library that Python loads") as caught:
        check_wheel(find_target(name), "prism")
    assert caught.value.given == name
    assert "aarch64-linux" in caught.value.allowed


def test_no_package_takes_the_name_of_this_one() -> None:
    with pytest.raises(InvalidNameError, match="the package that generates it"):
        check_wheel(find_target(None), "codegen")


def test_names_of_distributions_are_plain_and_differ() -> None:
    names = ["prism", "Prism", "a_b", "a__b", "a_", "A_b", "lambda", "None", "numpy", "json"]
    found = [name_distribution(name) for name in names]
    assert len(set(found)) == len(names)
    assert found[0] == "tensegrity_prism"
    assert all(name == name.lower().strip("_") and "__" not in name for name in found)


@pytest.mark.thorough
def test_the_package_passes_strict_type_checks(built: BuiltLibrary, tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="the package mypy is not installed")
    for path, data in unpack(build_wheel(built.manifest, built.path)[1]).items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_bytes(data)
    run(sys.executable, "-m", "mypy", "--strict", "-p", "tensegrity_Small_prism", folder=tmp_path)
