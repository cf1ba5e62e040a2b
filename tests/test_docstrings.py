"""Docstrings of public names: numpydoc sections that match the signatures, and examples that run."""

import dataclasses
import doctest
import importlib
import inspect
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import tensegrity_codegen
from tests.cases import thorough

ROOT = Path(__file__).resolve().parent.parent
MODULES = (
    "pipeline.build_library",
    "pipeline.build_library",
    "pipeline.compile_source",
    "control.embedded.build_controller",
    "control.embedded.closed_loop",
    "control.embedded.loaded",
    "export.export_acados",
    "export.export_fmu",
    "pipeline.compile_scene",
    "live.draw",
    "live.live_page",
    "tables.request",
    "runtime.analysis.analyse",
    "runtime.analysis.certificate",
    "runtime.analysis.linear_program",
    "structure.member_limits",
    "runtime.analysis.prestress",
    "runtime.analysis.rank",
    "control.feedback.closed_loop",
    "control.feedback.design.gains",
    "runtime.records.timed_motion",
    "control.feedback.study.study",
    "control.feedback.loop.tension_distribution",
    "control.feedback.time_motion",
    "runtime.linear.linearize",
    "runtime.model.model",
    "runtime.paths.continuation",
    "runtime.paths.model_path",
    "runtime.paths.find_equilibrium",
    "runtime.records.plan_result",
    "runtime.sensitivity.sensitivity",
    "runtime.profiles.profile",
    "runtime.profiles.read_profile",
    "runtime.simulate.simulate",
    "runtime.simulate.simulate_batch",
    "runtime.statics.batch.equilibria",
    "runtime.statics.batch.find_equilibria",
    "runtime.statics.equilibrium",
    "runtime.statics.equilibrium_record",
    "pipeline.settle",
    "structure.actuators",
    "structure.limits",
    "structure.structure",
)
# Names of these modules that serve other modules of the package only.
INTERNAL = {
    *("BATCH_WIDTHS", "INTERFACES", "check_batch_width", "check_interfaces", "complete_options"),
    *("BatchFunction", "CompiledFunction", "SparseBatch", "raise_for_status", "require_precision"),
    *("MEMBER_LIMITS", "MEMBER_SENSORS", "NODE_SENSORS", "SensorKind", "UNLIMITED"),
    *("simulation_quantities", "Pattern", "Method", "outline_motion"),
    *("live_folder", "find_request", "settle_drawable", "check_follow", "settle_method"),
    *("EXPORTER", "NUMBERS", "WORDS", "EquilibriaTable", "check_search_options"),
    *("equilibrium_quantities", "build_problem", "choose_tolerance", "describe_unheld"),
    *("BarPath", "StepControl", "find_snap", "find_load_snap", "join_snaps"),
    *("check_balanced", "find_optimum", "find_least_norm", "find_prestress", "find_rank", "count_freedom"),
    *("linearize_quantities", "find_kinks", "describe_kinks", "select_columns", "judge", "FreeMotions"),
    *(
        "PrestressStability",
        "find_prestress_stability",
        "find_stabilising_prestress",
        "Freedom",
        "name_moving",
    ),
    *("find_free_motions", "find_parts", "build_part_motions", "choose_even_knots"),
    *("read_until", "slip_until_held", "judge_snap"),
    *("record_outcome", "record_without_forces", "can_go_side_by_side", "block_size", "search_block"),
    *("find_equilibrium", "choose_request", "move_back", "LoopSource", "write_closed_loop"),
    *("has_statics", "with_statics", "settle_structure", "find_settled", "move_near_origin", "is_corrected"),
    *("follow_path", "remove_momentum", "check_members", "check_motion", "summarise_tensions"),
    *("describe_tensions", "render_live", "find_modes", "load_nodes", "is_library_source", "read_manifest"),
    *("compile_source", "check_buildable", "Sensing", "find_sensing", "find_cables", "CableTensions"),
    *("TensionLine", "TensionProgram", "name_moving"),
}
HEADINGS = ("Parameters", "Attributes", "Returns", "Raises", "Notes", "Examples")


def find_public() -> Iterator[tuple[str, Any]]:
    """Return what a user calls, by its full name: offered by the package or by one of MODULES."""
    for name in tensegrity_codegen.__all__:
        yield name, getattr(tensegrity_codegen, name)
    for path in MODULES:
        module = importlib.import_module(f"tensegrity_codegen.{path}")
        for name, item in vars(module).items():
            is_own = getattr(item, "__module__", "") == module.__name__ and not name.startswith("_")
            if is_own and name not in INTERNAL:
                yield f"{path}.{name}", item
    model = tensegrity_codegen.CompiledModel
    yield "CompiledModel.compute", model.compute
    yield "CompiledModel.compute_batch", model.compute_batch
    yield "Scene.to_toml", tensegrity_codegen.Scene.to_toml
    for name in ("position", "velocity_of", "tension", "to_pandas", "to_xarray"):
        yield f"Trajectory.{name}", getattr(tensegrity_codegen.Trajectory, name)


FOUND = {id(item): (name, item) for name, item in reversed(list(find_public()))}
PUBLIC = {name: item for name, item in FOUND.values() if inspect.isfunction(item) or inspect.isclass(item)}


def sections(item: Any) -> dict[str, str]:
    """Return heading -> text of a docstring; the heading is underlined."""
    parts = re.split(r"^(\w+)\n-{3,}\n", inspect.cleandoc(item.__doc__ or ""), flags=re.MULTILINE)
    assert len(parts) == len(set(parts[1::2])) * 2 + 1, "a heading appears twice"
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def names_in(section: str) -> set[str]:
    """Return the names that a section describes, "a, b : type" or "a, b" at the start of a line."""
    heads = [line.partition(" :")[0] for line in section.splitlines() if re.match(r"[*\w]", line)]
    return {name.strip().lstrip("*") for head in heads for name in head.split(",")}


def fields_of(item: Any) -> set[str]:
    return {field.name for field in dataclasses.fields(item)} if dataclasses.is_dataclass(item) else set()


@pytest.mark.parametrize("name", PUBLIC)
def test_sections_are_known_and_in_their_usual_order(name: str) -> None:
    found = list(sections(PUBLIC[name]))
    assert found == [heading for heading in HEADINGS if heading in found]


@pytest.mark.parametrize("name", [name for name, item in PUBLIC.items() if inspect.isfunction(item)])
def test_parameters_of_functions_are_those_of_the_signature(name: str) -> None:
    given, signature = sections(PUBLIC[name]), inspect.signature(PUBLIC[name])
    wanted = {parameter for parameter in signature.parameters if parameter != "self"}
    assert names_in(given.get("Parameters", "")) == wanted
    assert ("Returns" in given) == (signature.return_annotation not in (None, "None"))


@pytest.mark.parametrize("name", [name for name, item in PUBLIC.items() if dataclasses.is_dataclass(item)])
def test_attributes_of_dataclasses_are_their_fields(name: str) -> None:
    assert names_in(sections(PUBLIC[name]).get("Attributes", "")) == fields_of(PUBLIC[name])


@pytest.mark.parametrize("name", PUBLIC)
def test_raised_errors_exist(name: str) -> None:
    import tensegrity_codegen.system.errors as errors

    raised = names_in(sections(PUBLIC[name]).get("Raises", ""))
    assert raised <= set(vars(errors))


WITH_EXAMPLE = [name for name, item in PUBLIC.items() if ">>>" in (item.__doc__ or "")]
LONG = (
    *("design_distribution", "load_controller", "time_motion", "plan", "sweep"),
    *("study_control", "choose_weights", "find_equilibria", "simulate_batch"),
)


@pytest.mark.parametrize("name", [*(name for name in WITH_EXAMPLE if name not in LONG), *thorough(*LONG)])
def test_the_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for scene in ("prism", "prism12", "two_nodes", "pinned_prism"):
        shutil.copy(ROOT / f"tensegrity_codegen/scene/examples/{scene}.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    text = inspect.cleandoc(PUBLIC[name].__doc__ or "")
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    report: list[str] = []
    doctest.DocTestRunner(verbose=False).run(example, out=report.append)
    assert report == []


def test_the_functions_of_the_package_have_an_example() -> None:
    functions = [getattr(tensegrity_codegen, name) for name in tensegrity_codegen.__all__]
    missing = [f.__name__ for f in functions if inspect.isfunction(f) and ">>>" not in (f.__doc__ or "")]
    assert missing == []
