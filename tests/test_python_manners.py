"""The package in a user's hands: names, short texts, notebooks, and a typed script that uses everything."""

import ast
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tensegrity_codegen
from tensegrity_codegen import compile_scene, find_equilibrium, read_scene, simulate
from tensegrity_codegen.runtime.integrate.event_log import EventLog
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.summaries import Summarised
from tests.cases import thorough
from tests.models import EXAMPLES
from tests.user_script import SCENE, deliver, main

ROOT = Path(__file__).resolve().parent.parent
SCRIPT = ROOT / "tests" / "user_script.py"
NOTEBOOK = ROOT / "docs" / "notebooks" / "prism.ipynb"
DRAWN = ("scene", "structure", "small", "model", "found", "motion", "planned", "timed")


@pytest.fixture(scope="module", params=["some", *thorough("all")])
def results(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, object]:
    """What the user's script returns, or some of it."""
    if request.param == "all":
        return main(tmp_path_factory.mktemp("user"))
    model = compile_scene(SCENE, for_=("simulate", "equilibrium"))
    found, motion = find_equilibrium(model), simulate(model, t_end=0.5, samples=6)
    named = {"scene": read_scene(SCENE), "structure": model.structure, "small": model, "found": found}
    return {**named, "motion": motion}


def test_dir_shows_the_public_names_and_no_others() -> None:
    found = {name for name in dir(tensegrity_codegen) if not name.startswith("__")}
    assert found == set(tensegrity_codegen.__all__) - {"__version__"}
    assert "__version__" in dir(tensegrity_codegen)
    for name in tensegrity_codegen.__all__:
        assert getattr(tensegrity_codegen, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="simulat"):
        tensegrity_codegen.simulat  # type: ignore[attr-defined]  # noqa: B018


def test_the_script_uses_every_public_name() -> None:
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"))
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "tc"
    }
    assert set(tensegrity_codegen.__all__) - used == set()
    assert used - set(tensegrity_codegen.__all__) == set()


@pytest.mark.thorough
def test_the_whole_script_runs(tmp_path: Path) -> None:
    found = deliver(tmp_path, main(tmp_path))
    assert set(found) == {"tuning", "study", "runs", "loaded", "graphs", "fmu"}


def test_parts_of_results_have_a_repr_of_five_lines_at_most() -> None:
    structure, _ = tensegrity_codegen.load_scene(EXAMPLES / "two_nodes.toml")
    built = tensegrity_codegen.build_library(structure, tensegrity_codegen.ModelRequest(("member_tension",)))
    log = EventLog(np.arange(900.0), ("cable",) * 900, ("member1",) * 900, np.ones(900, dtype=np.int64), 900)
    for value in (built, log):
        lines = repr(value).splitlines()
        assert len(lines) <= 5
        assert max(map(len, lines)) <= 120


def test_every_result_has_a_repr_of_five_lines_at_most(results: Mapping[str, object]) -> None:
    for name, value in results.items():
        lines = repr(value).splitlines()
        assert 1 <= len(lines) <= 5, name
        if isinstance(value, Summarised):
            assert lines[0].startswith(type(value).__name__), name
            assert max(map(len, lines)) <= 102, name


def test_every_result_shows_itself_in_a_notebook(results: Mapping[str, object]) -> None:
    pytest.importorskip("matplotlib", reason="pictures need matplotlib")
    for name, value in results.items():
        if isinstance(value, Summarised):
            html = value._repr_html_()
            assert "<table>" in html, name
            assert ("<img" in html) == (name in DRAWN), name


def test_without_matplotlib_there_is_the_table_alone(
    results: Mapping[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    html = results["motion"]._repr_html_()  # type: ignore[attr-defined]
    assert "<table>" in html
    assert "<img" not in html


def test_a_library_without_its_scene_shows_a_table(results: Mapping[str, object]) -> None:
    model = results["small"]
    assert isinstance(model, CompiledModel)
    alone = CompiledModel(model.path)
    assert alone.structure is None
    assert "<img" not in alone._repr_html_()
    assert repr(alone).splitlines()[0] == "CompiledModel: lift, node_position, double precision"


def test_the_python_of_the_page_runs(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    names: dict[str, Any] = {}
    exec(compile(code[1], "docs/python.md", "exec"), names)
    assert names["motion"].status == "ok"


# --- the notebook ----------------------------------------------------------------------------------


def run_cells() -> list[Any]:
    """Return the value of the last expression of each code cell, as a notebook runs them."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    names: dict[str, Any] = {}
    shown = []
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "cell", "exec"), names)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))
    return shown


@pytest.mark.thorough
def test_the_cells_of_the_notebook_run_and_show_tables_and_pictures() -> None:
    pytest.importorskip("matplotlib", reason="pictures need matplotlib")
    shown = run_cells()
    kinds = [type(item).__name__ for item in shown]
    assert kinds[:4] == ["Scene", "CompiledModel", "Equilibrium", "Trajectory"]
    for item in shown[:4]:
        html = item._repr_html_()
        assert "<table>" in html
        assert "<img" in html
    assert shown[5]._repr_png_().startswith(b"\x89PNG")
    assert kinds[-1] == "LinearModel"


@pytest.mark.peers
@pytest.mark.filterwarnings("default")
def test_the_notebook_runs_in_a_kernel() -> None:
    nbclient = pytest.importorskip("nbclient", reason="needs the packages nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="needs the packages nbclient and ipykernel")
    import nbformat

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=200, resources={"metadata": {"path": str(ROOT)}}).execute()
    outputs = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    assert all(len(found) == 1 for found in outputs)
    for found in outputs[:4]:
        assert "<img" in found[0]["data"]["text/html"]
        assert len(found[0]["data"]["text/plain"].splitlines()) <= 5
    assert "image/png" in outputs[5][0]["data"]
