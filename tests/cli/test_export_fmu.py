"""`export fmu`: the JSON object, what is in the archive, and every refusal with exit code 2."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tests.cli.conftest import Run
from tests.cli.scenes import GOOD
from tests.export.scenes import LOOSE


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_archive_has_description_sources_and_binary(
    fmi: str, run: Run, two_nodes: Path, folder: Path
) -> None:
    ended = run.good(
        "export", "fmu", two_nodes, "-o", "two.fmu", "--fmi", fmi, "--t-end", 3, "--rtol", 1e-7, "--json"
    )
    assert ended.data["n_states"] == 6
    with zipfile.ZipFile(folder / "two.fmu") as archive:
        names = archive.namelist()
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    assert names[0] == "modelDescription.xml"
    assert set(ended.data["binaries"]) <= set(names)
    assert len(ended.data["binaries"]) == 1
    assert "sources/two_nodes_fmu.c" in names
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert (experiment.get("stopTime"), experiment.get("tolerance")) == ("3.0", "1e-07")
    assert (root.get("guid") or root.get("instantiationToken")) == ended.data["token"]


def test_the_same_scene_gives_the_same_bytes_and_another_one_another_token(
    run: Run, two_nodes: Path, folder: Path
) -> None:
    words = ("export", "fmu", two_nodes, "--sources-only", "--json")
    first, second = run(*words, "-o", "a.fmu"), run(*words, "-o", "b.fmu")
    assert (folder / "a.fmu").read_bytes() == (folder / "b.fmu").read_bytes()
    assert first.data["token"] == second.data["token"]
    text = two_nodes.read_text(encoding="utf-8")
    two_nodes.write_text(text.replace("-9.81", "-9.8"), encoding="utf-8")
    assert run(*words, "-o", "c.fmu").data["token"] != first.data["token"]


def test_outputs_are_chosen_by_name(run: Run, two_nodes: Path) -> None:
    words = ("export", "fmu", two_nodes, "-o", "a.fmu", "--sources-only", "--json", "--overwrite")
    assert (
        run(*words, "--output", "total_energy").data["n_outputs"]
        == 1 + run(*words).data["n_event_indicators"] + 1
    )


@pytest.mark.thorough
def test_a_large_structure_has_no_derivatives_and_the_result_says_so(run: Run, folder: Path) -> None:
    text = list_examples()["tower"].replace("stages = 3", "stages = 24").replace("emitter", "# emitter")
    (folder / "high.toml").write_text(text, encoding="utf-8")
    ended = run.good(
        "export", "fmu", "high.toml", "-o", "a.fmu", "--sources-only", "--method", "rk54", "--json"
    )
    assert ended.data["has_derivatives"] is False
    assert "directional derivatives" in ended.data["notes"][0]
    with zipfile.ZipFile(folder / "a.fmu") as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    interface = root.find("CoSimulation")
    assert interface is not None
    assert interface.get("providesDirectionalDerivative") == "false"


@pytest.mark.parametrize(
    ("words", "where", "text"),
    [
        (("--fmi", "1.0"), "--fmi", "2.0, 3.0"),
        (("--kind", "se"), "--kind", "me, cs, both"),
        (("--t-end", "0"), "--t-end", "finite number > 0"),
        (("--rtol", "2"), "--rtol", "number > 0 and < 1"),
        (("--method", "rk4"), "--method", "rk853"),
        (("--method", "scipy_lsoda"), "--method", "rk853"),
        (("--method", "euler"), "--method", "rk853"),
        (("--output", "tangent_stiffness"), "--output", "member_tension"),
        (("--output", "tension"), "quantities", "member_tension"),
        (("--compiler", "no-such-compiler"), "", "no-such-compiler"),
        (("--target", "toaster"), "--target", "aarch64-linux"),
        (("--target", "wasm32"), "--target", "x86_64-windows"),
        (("-o", "a.zip"), "a.zip", ".fmu"),
    ],
)
def test_a_wrong_option_is_refused(
    words: tuple[str, ...], where: str, text: str, run: Run, two_nodes: Path, folder: Path
) -> None:
    ended = run.refused("export", "fmu", two_nodes, "-o", "a.fmu", *words, "--json")
    assert text in str(ended.data)
    assert where in ended.data["where"]
    assert [path.name for path in folder.iterdir()] == [two_nodes.name]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (GOOD.replace(", mass = 1.0", ""), "mass"),
        (LOOSE.replace("[model]", '[model]\nprecision = "single"'), "double precision"),
        (LOOSE.replace('"loose"', '"lo<&>ose"'), "name"),
        (LOOSE.replace('name = "winch"', 'name = "win\'ch"'), "name"),
        (LOOSE.replace('name = "winch"', 'name = "wínch"'), "name"),
    ],
)
def test_a_scene_that_makes_no_unit_is_refused(text: str, problem: str, run: Run, folder: Path) -> None:
    (folder / "bad.toml").write_text(text, encoding="utf-8")
    ended = run.refused("export", "fmu", "bad.toml", "-o", "a.fmu", "--json")
    assert problem in ended.data["problem"] + ended.data["where"]
    assert [path.name for path in folder.iterdir()] == ["bad.toml"]


def test_without_a_compiler_the_error_says_so(
    run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tensegrity_codegen.system.errors import CompilerMissingError

    def find(_: object) -> None:
        raise CompilerMissingError("no C compiler was found", hint="pip install ziglang")

    monkeypatch.setattr("tensegrity_codegen.export.fmu.sources.find_compiler", find)
    ended = run("export", "fmu", two_nodes, "-o", "a.fmu", "--json")
    assert (ended.code, ended.data["error"]) == (2, "CompilerMissingError")
    run.good("export", "fmu", two_nodes, "-o", "a.fmu", "--sources-only")
