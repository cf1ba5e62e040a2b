"""Public functions given wrong values, each argument in turn: named errors or results, no bare errors."""

import inspect
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, draw, find_equilibrium, load_scene, read_scene, view
from tensegrity_codegen.export.export_fmu import export_fmu
from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.find_equilibrium import find_load_snap, find_snap
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.paths.watches import watch_contact, watch_members, watch_slack, watch_switch
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.checks.scene_warnings import find_warnings
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.write import write_scene
from tests.models import EXAMPLES
from tests.scene.formats.test_import_tables import MEMBERS, NODES
from tests.wrong_calls import WRONG, list_bare_errors

PRISM = EXAMPLES / "prism.toml"


class Calls:
    """A right call of each function: its arguments by name."""

    def __init__(self, folder: Path) -> None:
        model = compile_scene(PRISM, for_=("load_path", "equilibrium"))
        scene, (structure, _) = read_scene(PRISM), load_scene(PRISM)
        load = np.zeros((6, 3))
        load[3] = [0, 0, -1]
        path, found = build_path(model, load), find_equilibrium(model)
        self.found = found
        self.path = follow_path(path, found.coordinate, most=1.0)
        out = {"overwrite": True}
        tables = [folder / "nodes.csv", folder / "members.csv"]
        for table, text in zip(tables, (NODES, MEMBERS), strict=True):
            table.write_text(text)
        self.right: dict[Callable[..., Any], dict[str, Any]] = {
            build_path: {"model": model, "pattern": load, "arguments": {}},
            watch_slack: {"path": path, "members": ["top1"]},
            watch_switch: {"path": path, "members": ["top1"]},
            watch_contact: {"path": path, "pairs": None, "stops": True},
            watch_members: {"path": path, "structure": structure},
            follow_path: {"problem": path, "start": found.coordinate, "most": 1.0},
            StepControl: {},
            find_snap: {"model": model, "found": found, "base": 0 * load, "load": load},
            find_load_snap: {"model": model, "found": found, "loads": {"node_load": load}},
            find_equilibrium: {"model": model},
            read_scene: {"path": PRISM},
            load_scene: {"path": PRISM},
            assemble: {"scene": scene},
            check_structure: {"structure": structure},
            find_warnings: {"structure": structure},
            write_scene: {"document": scene.to_document(), "path": folder / "new.toml", **out},
            draw: {"subject": structure},
            view: {"subject": structure},
            export_fmu: {"scene": PRISM, "out": folder / "prism.fmu", "sources_only": True, **out},
            read_files: {"paths": tables},
        }


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> Calls:
    return Calls(tmp_path_factory.mktemp("calls"))


FUNCTIONS = (
    *(build_path, watch_slack, watch_switch, watch_contact, watch_members, follow_path, StepControl),
    *(find_snap, find_load_snap, find_equilibrium, read_scene, load_scene, assemble, check_structure),
    *(find_warnings, write_scene, draw, view, export_fmu, read_files),
)
SLOW = (find_snap, find_load_snap, draw, view, export_fmu)


def list_bare(calls: Calls, function: Callable[..., Any], values: tuple[Any, ...]) -> list[str]:
    kinds = inspect.signature(function).parameters.values()
    names = [item.name for item in kinds if item.kind is not item.VAR_KEYWORD]
    return list_bare_errors(function, calls.right[function], names, values)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_wrong_calls_are_named_errors(
    calls: Calls, function: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    function(**calls.right[function])
    assert list_bare(calls, function, WRONG[2::16] if function in SLOW else WRONG) == []


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("function", SLOW, ids=lambda function: function.__name__)
def test_wrong_calls_of_slow_functions_are_named_errors(
    calls: Calls, function: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert list_bare(calls, function, WRONG) == []


def test_equilibria_and_load_paths_are_pickled(calls: Calls) -> None:
    for result in (calls.found, calls.path):
        again = pickle.loads(pickle.dumps(result))
        assert type(again) is type(result)
        assert again.status == result.status
        assert np.array_equal(again.coordinate, result.coordinate)
        assert repr(again) == repr(result)
