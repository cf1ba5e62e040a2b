import hashlib
import json
import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import issparse

from tensegrity_codegen import find_equilibrium, linearize
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.codegen import emit
from tensegrity_codegen.codegen.compilation.cache import Cache, CacheEntry
from tensegrity_codegen.pipeline.analyses import find_needs, want_analyses
from tensegrity_codegen.pipeline.build_library import (
    FEW_CALLS,
    MANY_CALLS,
    BuiltLibrary,
    build_library,
    check_buildable,
)
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.system.errors import CompileError, LibraryError, OutputError, UnknownNameError
from tensegrity_codegen.system.output_folder import LIST_FILE
from tests.cases import thorough
from tests.codegen.compilers import POSIX, chosen_compiler, require_compiler, write_script
from tests.models import EXAMPLES
from tests.reference import ReferenceModel

# Build, load and simulate; say what was imported. Waits for a line on standard input first.
CHILD = """
import json, sys
sys.stdin.readline()
from tensegrity_codegen.pipeline.compile_scene import build_library, load_scene
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
structure, request = load_scene(sys.argv[1])
wanted = request.wanting(*SIMULATION_QUANTITIES, integrators=("rk4",))
built = build_library(structure, wanted)
run = simulate(built.load(), 0.1, samples=3, method="rk4", stepping=Stepping(step=0.001))
print(json.dumps({"casadi": "casadi" in sys.modules, "from_cache": built.from_cache, "status": run.status,
                  "key": built.entry.key, "end": run.node_position[-1].tolist()}))
"""
SIMULATED = ("acceleration", "member_tension", "kinetic_energy", "total_energy")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "two_nodes.toml"
    path.write_text(list_examples()["two_nodes"], encoding="utf-8")
    return path


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    """A cache of its own, empty at first."""
    return Cache(tmp_path / "cache")


def build(scene: Path, *quantities: str, integrators: tuple[str, ...] = (), **options: Any) -> BuiltLibrary:
    structure, request = load_scene(scene)
    wanted = request.wanting(*(quantities or ("member_length",)), integrators=integrators)
    return build_library(structure, wanted, **options)


def spawn(scene: Path, cache: Cache) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(scene)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), CACHE_VARIABLE: str(cache.root)},
    )


def test_the_second_build_comes_from_the_cache(scene: Path, cache: Cache) -> None:
    first, second = build(scene, cache=cache), build(scene, cache=cache)
    assert (first.from_cache, second.from_cache) == (False, True)
    assert first.path == second.path
    assert first.manifest == second.manifest


@pytest.mark.optimised
def test_a_cached_library_is_used_without_casadi(scene: Path, cache: Cache) -> None:
    built = build(scene, *SIMULATION_QUANTITIES, integrators=("rk4",), cache=cache)
    told = json.loads(spawn(scene, cache).communicate("go\n", timeout=200)[0])
    assert (told["key"], told["from_cache"], told["casadi"]) == (built.entry.key, True, False)
    run = simulate(built.load(), 0.1, samples=3, method="rk4", stepping=Stepping(step=0.001))
    assert (told["status"], told["end"]) == (run.status, run.node_position[-1].tolist())


def test_every_change_of_what_is_asked_leads_to_another_entry(scene: Path, cache: Cache) -> None:
    built = [
        build(scene, cache=cache),
        build(scene, "member_tension", cache=cache),
        build(scene, cache=cache, flags="native"),
        build(scene, cache=cache, compiler=require_compiler("clang").name),
    ]
    text = scene.read_text(encoding="utf-8")
    scene.write_text(text.replace("length = 1.0\nalong", "length = 1.25\nalong"), encoding="utf-8")
    built.append(build(scene, "member_tension", cache=cache))
    scene.write_text(text.replace("spring_constant = 80 ", "spring_constant = 81 "), encoding="utf-8")
    built.append(build(scene, "member_tension", cache=cache))
    assert not any(item.from_cache for item in built)
    assert len({item.entry.key for item in built}) == len(built)


@pytest.mark.parametrize("flags", ["reference", "native"])
@pytest.mark.parametrize("family", ["gcc", "clang"])
def test_every_compiler_and_flag_set_computes_the_same(family: str, flags: str, scene: Path) -> None:
    require_compiler(family)
    model = build(scene, "node_force", "acceleration", compiler=family, flags=flags).load()
    reference = ReferenceModel(load_scene(scene)[0], parameters={})
    coordinate = np.array([0.1, -0.2, -1.3])
    for quantity in ("node_force", "acceleration"):
        found = model.compute(quantity, coordinate=coordinate)
        np.testing.assert_allclose(
            found, reference.compute(quantity, coordinate=coordinate), rtol=1e-13, atol=1e-13
        )


@pytest.mark.thorough
@pytest.mark.parametrize("part", ["library", "manifest", "entry.json"])
@pytest.mark.parametrize("keep", [0, 0.5])
def test_a_broken_entry_is_built_anew(part: str, keep: float, scene: Path, cache: Cache) -> None:
    whole = build(scene, cache=cache)
    path = {"library": whole.path, "manifest": whole.entry.manifest}.get(part, whole.entry.folder / part)
    assert path is not None
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(data[: int(keep * len(data))])
    again = build(scene, cache=cache)
    assert not again.from_cache
    assert again.manifest == whole.manifest
    assert again.load().compute("member_length").tolist() == [1.0]
    assert build(scene, cache=cache).from_cache


def test_a_request_that_leads_nowhere_is_built_anew(scene: Path, cache: Cache) -> None:
    whole = build(scene, cache=cache)
    shutil.rmtree(whole.entry.folder)
    assert not build(scene, cache=cache).from_cache
    for request in (cache.root / "requests").iterdir():
        request.write_text("rubbish", encoding="utf-8")
    assert build(scene, cache=cache).path.is_file()


@POSIX
def test_a_failed_compilation_leaves_no_entry(scene: Path, cache: Cache, tmp_path: Path) -> None:
    script = write_script(tmp_path / "cc", 'if [ "$1" = --version ]; then echo cc 1.0; else exit 1; fi')
    with pytest.raises(CompileError):
        build(scene, cache=cache, compiler=str(script))
    assert list(cache.root.glob("libraries/*")) == []
    assert list(cache.root.glob("temporary/*")) == []
    assert not build(scene, cache=cache).from_cache


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize("quantities", [("member_length",), *thorough((SIMULATED,))])
def test_the_exported_folder_compiles_by_itself(
    quantities: tuple[str, ...], scene: Path, tmp_path: Path
) -> None:
    folder = build(scene, *quantities).export(tmp_path / "there" / "library")
    outcome = subprocess.run(
        ["make", chosen_compiler()], cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert outcome.returncode == 0, outcome.stderr
    assert "warning" not in outcome.stderr
    ran = subprocess.run([str(folder / "example")], capture_output=True, text=True, timeout=20)
    assert ran.returncode == 0
    assert ran.stdout


def test_an_export_holds_what_the_cache_holds(scene: Path, tmp_path: Path) -> None:
    built = build(scene)
    folder = built.export(tmp_path / "library")
    held = set(built.entry.files) - {"compile.log"}
    written = {path.name for path in folder.iterdir()}
    build_files = {"CMakeLists.txt", "README.md", "NOTICE.md"}
    assert held | {LIST_FILE} | build_files <= written
    others = written - held - {LIST_FILE} - build_files
    assert all(name.startswith("tensegrity_two_nodes") for name in others)  # of CMake and pkg-config
    assert (folder / built.path.name).read_bytes() == built.path.read_bytes()
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(OutputError):
        built.export(tmp_path / "file")


@pytest.mark.optimised
def test_measuring_fills_in_bytes(scene: Path) -> None:
    measured, estimated = build(scene, measure=True), build(scene)
    assert measured.entry.key != estimated.entry.key
    rows = {row.what: row for row in measured.manifest.left_out}
    assert rows
    assert all(row.measured for row in rows.values())
    assert rows["unwanted functions"].object_bytes > 0
    assert not any(row.measured for row in estimated.manifest.left_out)


@pytest.mark.optimised
@pytest.mark.parametrize("name", ["prism", *thorough("tower", "planar", "svd_tower")])
def test_libraries_for_few_calls_are_loops_with_the_same_values(name: str) -> None:
    structure, request = load_scene(tomllib.loads(list_examples()[name]))
    wanted = find_needs("analyse", structure, request).alone(request)
    quick, usual = (build_library(structure, wanted, calls=calls) for calls in (FEW_CALLS, MANY_CALLS))
    assert quick.manifest.left_out == usual.manifest.left_out == ()
    assert "-O1" in quick.flags
    assert "-O2" in usual.flags
    assert quick.manifest.emitter == ("table" if request.formulation == "node_position" else "unrolled")
    models = quick.load(), usual.load()
    start = models[0].nominal("coordinate")
    away = start + np.random.default_rng(0).normal(scale=1e-3, size=start.shape)
    for item in usual.manifest.functions:
        given = {"coordinate": away} if "coordinate" in item.arguments else {}
        found = [model.compute(item.quantity, **given) for model in models]
        values = [item.toarray() if issparse(item) else item for item in found]
        np.testing.assert_array_equal(*values)  # 0.0 and -0.0 are equal


def test_a_model_that_was_checked_is_not_built_again(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    structure, request = load_scene(scene)
    made = []
    usual = emit._plan
    monkeypatch.setattr(emit, "_plan", lambda *given: made.append(given) or usual(*given))
    check_buildable(structure, request)
    check_buildable(structure, request)
    emit.emit(structure, request, account=False)
    assert len(made) == 1
    emit.emit(structure, request, account=False)
    assert len(made) == 2


def test_a_scene_becomes_a_model_that_simulates(scene: Path) -> None:
    before = scene.read_bytes()
    model = compile_scene(scene, quantities=SIMULATED, integrators=("rk54",))
    assert simulate(model, 0.2, samples=3, method="rk54").status == "ok"
    assert all(model.has(quantity) for quantity in SIMULATED)
    assert scene.read_bytes() == before


def test_a_model_has_all_that_its_analyses_need(scene: Path) -> None:
    model = compile_scene(scene, for_=("simulate", "simulate_batch", "equilibrium", "linearize", "load_path"))
    assert simulate(model, 0.1, samples=2).status == "ok"
    assert simulate_batch(model, 0.1, samples=2, coordinate=[model.nominal("coordinate")] * 2).is_ok.all()
    assert find_equilibrium(model).is_found
    assert linearize(model).input_name == ()
    assert build_path(model, {"node_load": 1.0 + model.nominal("node_load")}).model is model


def test_interfaces_are_compiled_for_no_analysis(scene: Path) -> None:
    structure, request = load_scene(scene)
    asked = replace(request, interfaces=("casadi_hessian",))
    for analysis in ("simulate", "equilibrium", "linearize", "load_path"):
        needs = find_needs(analysis, structure, asked)
        assert needs.alone(asked).interfaces == needs.besides(asked).interfaces == ()
        assert want_analyses(structure, asked, [analysis]).interfaces == ()
    assert want_analyses(structure, asked, []).interfaces == ("casadi_hessian",)


def test_an_unknown_analysis_is_refused_with_the_known_ones(scene: Path) -> None:
    with pytest.raises(UnknownNameError) as caught:
        compile_scene(scene, for_="simulation")
    assert caught.value.where == "for_"
    assert "simulate_batch" in caught.value.allowed


def test_a_parameter_may_be_asked_for_from_outside(scene: Path) -> None:
    model = compile_scene(scene, quantities=("member_tension",), parameters={"rest_length": (0,)})
    assert model.compute("member_tension", rest_length=[0.75]).tolist() == pytest.approx([80 * 0.25])


def test_an_entry_without_library_is_an_error(scene: Path, cache: Cache) -> None:
    built = build(scene, cache=cache)
    entry = CacheEntry("ab" * 16, built.entry.folder, ("manifest.json",))
    broken = BuiltLibrary(entry, built.manifest, built.compiler, built.flags, False, 0.0)
    with pytest.raises(LibraryError, match="no library"):
        broken.load()


# --- libraries that are not what they should be -----------------------------------------------------


def change_library(built: BuiltLibrary, content: bytes) -> None:
    """Put another library into the entry, with the checksums that go with it."""
    built.path.unlink()
    built.path.write_bytes(content)
    path = built.entry.folder / "entry.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    data["files"][built.path.name] = {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    path.write_text(json.dumps(data), encoding="utf-8")


def lying_compiler(folder: Path, write: str) -> Path:
    """Return a compiler that ends well and whose output the shell command `write` makes, in $out."""
    body = f"""
if [ "$1" = --version ]; then echo "liar 1.0"; exit 0; fi
while [ $# -gt 0 ]; do if [ "$1" = -o ]; then out="$2"; fi; shift; done
{write}
"""
    return write_script(folder / "liar", body)


# A header of the right kind with nothing behind it; of this processor (076: x86-64) or another (363: RISC-V).
ELF = r"""printf '\177ELF\2\1\1\0\0\0\0\0\0\0\0\0\3\0\%s\0' > "$out" """
CRASH = r"#include <stdlib.h>\n__attribute__((constructor)) void f(void) { abort(); }"
LINK = '> made.c; cc -shared -fPIC -o "$out" made.c'
LIES = {
    "garbage": 'echo garbage > "$out"',
    "empty": ': > "$out"',
    "cut short": ELF % "076",
    "another processor": ELF % "363",
    "another library": f"echo 'int other;' {LINK}",
    "a library that crashes": f"printf '{CRASH}\\n' {LINK}",
}


@pytest.mark.thorough
@pytest.mark.optimised
@POSIX
@pytest.mark.parametrize("write", LIES.values(), ids=LIES)
def test_what_a_lying_compiler_writes_is_not_kept(
    write: str, scene: Path, cache: Cache, tmp_path: Path
) -> None:
    with pytest.raises(CompileError, match="reported success but wrote") as caught:
        build(scene, cache=cache, compiler=str(lying_compiler(tmp_path, write)))
    assert "liar" in caught.value.where
    assert "doctor" in caught.value.hint
    assert list(cache.root.glob("libraries/*")) == []
    assert list(cache.root.glob("temporary/*")) == []
    assert build(scene, cache=cache).load().compute("member_length").tolist() == [1.0]


@pytest.mark.optimised
def test_the_library_of_another_scene_from_the_compiler_is_refused(
    scene: Path, cache: Cache, tmp_path: Path
) -> None:
    other = tmp_path / "other.toml"
    text = scene.read_text(encoding="utf-8")
    other.write_text(text.replace("length = 1.0\nalong", "length = 1.25\nalong"), encoding="utf-8")
    wrong = lying_compiler(tmp_path, f'cp "{build(other, cache=cache).path}" "$out"')
    with pytest.raises(CompileError, match="another scene"):
        build(scene, cache=cache, compiler=str(wrong))


def test_a_kept_library_that_does_not_load_is_built_again(scene: Path, cache: Cache) -> None:
    whole = build(scene, cache=cache).path.read_bytes()
    change_library(build(scene, cache=cache), b"no library any more")
    built = build(scene, cache=cache)
    assert built.from_cache
    assert built.load().compute("member_length").tolist() == [1.0]
    assert built.path.read_bytes() == whole
    assert build(scene, cache=cache).from_cache


def test_a_request_that_leads_to_the_library_of_another_scene_is_not_believed(
    scene: Path, cache: Cache
) -> None:
    text = scene.read_text(encoding="utf-8")
    first = build(scene, cache=cache)
    scene.write_text(text.replace("length = 1.0\nalong", "length = 1.25\nalong"), encoding="utf-8")
    second = build(scene, cache=cache)
    requests = sorted((cache.root / "requests").iterdir())
    assert len(requests) == 2
    contents = [path.read_bytes() for path in requests]
    for path, content in zip(requests, reversed(contents), strict=True):
        path.write_bytes(content)
    again = build(scene, cache=cache)
    assert again.path == second.path
    assert again.load().compute("member_length").tolist() == [1.25]
    scene.write_text(text, encoding="utf-8")
    assert build(scene, cache=cache).path == first.path
    assert build(scene, cache=cache).load().compute("member_length").tolist() == [1.0]


def test_a_request_that_leads_to_a_library_of_other_quantities_is_not_believed(
    scene: Path, cache: Cache
) -> None:
    build(scene, "member_length", cache=cache)
    build(scene, "member_tension", cache=cache)
    requests = sorted((cache.root / "requests").iterdir())
    contents = [path.read_bytes() for path in requests]
    for path, content in zip(requests, reversed(contents), strict=True):
        path.write_bytes(content)
    assert build(scene, "member_length", cache=cache).load().has("member_length")
    assert build(scene, "member_tension", cache=cache).load().has("member_tension")


@pytest.mark.thorough
def test_four_processes_may_build_one_scene_at_once(scene: Path, cache: Cache) -> None:
    children = [spawn(scene, cache) for _ in range(4)]
    for child in children:
        assert child.stdin is not None
        child.stdin.write("go\n")
        child.stdin.flush()
    answers = [json.loads(child.communicate(timeout=200)[0]) for child in children]
    assert [item["status"] for item in answers] == ["ok"] * 4
    assert len({item["key"] for item in answers}) == 1
    assert len({json.dumps(item["end"]) for item in answers}) == 1
    assert len(list((cache.root / "libraries").iterdir())) == 1
    assert list((cache.root / "temporary").iterdir()) == []


ACTUATED = """
[[actuators]]
name = "motor"
members = "all_strings"
rate = {rate}

[groups]
all_strings = ["{member}"]

[limits]
least_tension = {least}
"""


def test_new_limits_and_rates_find_the_same_library(scene: Path, cache: Cache) -> None:
    text = scene.read_text(encoding="utf-8")
    member = load_scene(scene)[0].member_name[0]
    built = []
    for rate, least in ((0.1, 1.0), (0.2, 2.0)):
        scene.write_text(text + ACTUATED.format(member=member, rate=rate, least=least), encoding="utf-8")
        built.append(build(scene, "member_tension", cache=cache))
    assert [item.from_cache for item in built] == [False, True]
    assert built[0].entry.key == built[1].entry.key
    for item, rate, least in zip(built, (0.1, 0.2), (1.0, 2.0), strict=True):
        model = item.load()
        assert model.structure is not None
        assert model.manifest.input_name == ("motor",)
        assert model.structure.actuators[0].rate == rate
        assert model.structure.limits.least_tension[0] == least
        assert model.compute("member_tension", motor=-0.01) == pytest.approx([0.8])


def test_corrected_rigid_bars_are_simulated_and_settle_in_node_positions() -> None:
    """Stiff bars are rigid there, so that the motion needs no implicit method, and statics take springs."""
    bars = {"formulation": "rigid_bar", "options": {"bars": "all", "correction": "first_order"}}
    springs = {"a": (0.0, 0.0), "b": (1.0, 0.0), "c": (2.00005, 0.0), "d": (3.00005, 0.0)}
    scene = {
        "name": "corrected",
        "axes": "xz",
        "model": bars,
        "nodes": {name: {"position": place, "mass": 1.0} for name, place in springs.items()},
        "members": {
            "left": {"kind": "cable", "spring_constant": 100.0, "rest_length": 0.9, "nodes": ["a", "b"]},
            "rod": {"kind": "bar", "spring_constant": 2e5, "rest_length": 1.0, "nodes": ["b", "c"]},
            "right": {"kind": "cable", "spring_constant": 100.0, "rest_length": 0.9, "nodes": ["c", "d"]},
        },
    }
    for name in ("a", "d"):
        scene["nodes"][name] = {"position": springs[name], "anchored": True}
    model = compile_scene(scene, for_="simulate")
    assert model.manifest.formulation == "rigid_bar"
    assert [item.name for item in model.manifest.integrators] == ["rk853"]
    assert simulate(model, 0.1, samples=3).status == "ok"
    at_rest = compile_scene(scene, for_=("equilibrium", "linearize"))
    assert at_rest.manifest.formulation == "node_position"
    assert find_equilibrium(at_rest).member_length[1] == pytest.approx(1.0 + 10.0 / 2e5, rel=1e-5)


def test_derivatives_are_needs_of_a_library() -> None:
    structure, request = load_scene(EXAMPLES / "prism.toml")
    quantities = want_analyses(structure, request, ("derivatives",))
    assert {f"{name}_slopes" for name in ("acceleration", "member_tension", "total_energy")} <= {
        *quantities.quantities
    }
    assert quantities.batch_width == 8
    motions = want_analyses(structure, request, ("motion_derivatives",), method="tsit5")
    assert {"adjoint_rate", "adjoint_tension", "tension_column"} <= {*motions.quantities}
    # The scene asks for rk4, whose motions have no derivatives.
    assert (motions.integrators, motions.directions, motions.batch_width) == (("tsit5",), ("tangent",), 0)
