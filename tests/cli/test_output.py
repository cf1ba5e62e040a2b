"""What verbs print of large structures: below 60 lines, what matters most first; all where asked for."""

import json
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from rich.table import Table

from tensegrity_codegen.analyses.analyse import Analyse, AnalyseResult
from tensegrity_codegen.analyses.cases.record import Result
from tensegrity_codegen.analyses.cases.scene_case import SceneCase
from tensegrity_codegen.analyses.equilibrium import EquilibriumResult
from tensegrity_codegen.analyses.linearize import LinearResult
from tensegrity_codegen.analyses.plan import PlanAnswer
from tensegrity_codegen.analyses.sensitivity import FindSensitivity, SensitivityResult
from tensegrity_codegen.cli.output import MOST_WARNINGS, Output
from tensegrity_codegen.control.pages import control_studies
from tensegrity_codegen.report.long_table import LongTable
from tensegrity_codegen.report.result_tables import events_table
from tensegrity_codegen.runtime.analysis.analyse import analyse as find_analysis
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.analysis.configuration import Modes
from tensegrity_codegen.runtime.analysis.prestress import Prestress
from tensegrity_codegen.runtime.linear.linearize import LinearModel
from tensegrity_codegen.runtime.linear.spectrum import Spectrum
from tensegrity_codegen.runtime.paths.load_path import PathEvent
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.summary.finding import list_tables
from tensegrity_codegen.tables.request import ModelRequest
from tests.reference import ReferenceModel
from tests.runtime.build import make_structure, prism

BELOW = 60  # lines
SIDE = 69  # nodes along a side of the net: 9,384 cables
N_MEMBERS = 2 * SIDE * (SIDE - 1)
LONG = "a_long_name_of_a_member_in_a_large_net_"


def make_net(side: int = SIDE) -> Structure:
    """A square net of cables in rows and columns; the first ten members are bars."""
    place = np.arange(side * side).reshape(side, side)
    ends = np.concatenate(
        [np.stack([place[:, :-1], place[:, 1:]], -1), np.stack([place[:-1], place[1:]], -1).swapaxes(0, 1)]
    )
    ends = ends.reshape(-1, 2)
    members = [
        {"ends": pair, "mu": 100.0, "rest": 0.9, "tension_only": k > 9, "bar": k < 10}
        for k, pair in enumerate(ends.tolist())
    ]
    position = np.stack(
        [np.repeat(np.arange(side), side), np.tile(np.arange(side), side), np.zeros(side**2)], axis=1
    )
    structure = make_structure(position, members)
    return replace(structure, member_name=tuple(f"{LONG}{k}" for k in range(len(members))))


@pytest.fixture(scope="module")
def net() -> Structure:
    return make_net()


def settle_net(net: Structure) -> Equilibrium:
    """An equilibrium of the net, made up: cables pull the more the higher their number, two are slack."""
    tension = np.where(net.is_bar, -1.0 - np.arange(net.n_members), 0.01 * np.arange(net.n_members))
    tension[[k for k in (4000, 5000) if k < len(tension)]] = 0.0
    position = net.node_position + 1e-4 * np.arange(net.n_nodes)[:, None]
    count = net.n_nodes
    return Equilibrium(
        "converged", "newton", position.ravel(), position, np.ones(net.n_members), tension, 1e-12, 90.0, 5,
        3.0, 0, 1.0, -0.1, 0.5, f"n{count - 1}", "", 0.5, f"n{count - 1}", (), 68.0, structure=net,
        node_name=net.node_name, member_name=net.member_name,
    )  # fmt: skip


def case_of(net: Structure) -> SceneCase:
    return SceneCase(net, ModelRequest(()))


def print_result(output: Output, result: Result) -> None:
    """Print an answer as verbs do."""
    output.result(result.as_dict(), *result.describe())


def report_equilibrium(output: Output, net: Structure) -> None:
    print_result(output, EquilibriumResult(settle_net(net), case_of(net)))


def report_analysis(output: Output, net: Structure) -> None:
    """An analysis of everything at once: a proof, modes, limits of members."""
    small = find_analysis(ReferenceModel(prism(160.0)), n_modes=8)
    found, n = settle_net(net), net.n_members
    tension, motion = found.member_tension, 1e-3 * np.arange(3.0 * net.n_nodes).reshape(-1, 3)
    proof = Certificate(motion.ravel(), -tension, tuple(range(10, n)), 0.0, 0.0, 0.1, 0.0, 1e-15, True)
    limits = replace(Limits().for_members(n), least_tension=np.full(n, 1.0), most_tension=np.full(n, 50.0))
    modes = Modes(np.linspace(0.0, 5.0, 500), np.zeros(500), np.zeros((net.n_nodes, 3, 500)), 6, 500)
    whole = replace(
        small, status="infeasible", member_tension=tension, member_length=found.member_length, modes=modes,
        prestress=Prestress(False, tension, 0.0, 90.0), certificate=proof, certificate_displacement=motion,
        members=check_members(replace(net, limits=limits), tension, found.member_length),
    )  # fmt: skip
    print_result(output, AnalyseResult(case_of(net), Analyse(), whole, None))


def report_sensitivity(output: Output, net: Structure) -> None:
    n, rows = net.n_members, 40
    names = tuple(f"{LONG}{k}" for k in range(rows))
    tension = np.random.default_rng(1).standard_normal((rows, n))
    found = Sensitivity(
        tension, tension, np.repeat(tension[:, None], 3, axis=1), names, names, names, net.member_name, (),
        np.zeros((rows, 0)), net.member_name[:4322], (), 1.0, 1e-12, 1e-12, 90.0,
    )  # fmt: skip
    print_result(output, SensitivityResult(FindSensitivity(), found))


def report_linear_model(output: Output, net: Structure) -> None:
    n = 2 * len(net.node_name)
    frequency = np.linspace(0.5, 5.0, n // 2)
    value = 2j * np.pi * np.repeat(frequency, 2) * np.tile([1, -1], n // 2)
    spectrum = Spectrum(value, True, frequency, np.zeros(n // 2), 0, 0)
    zero, names = np.zeros(n), tuple(f"x{k}" for k in range(n))
    matrix = scipy.sparse.csr_array((n, n))
    kinks = dict.fromkeys(net.member_name, True)
    linear = LinearModel(matrix, matrix, zero, zero, zero, np.zeros(0), names, (), spectrum, None, kinks)
    print_result(output, LinearResult(linear))


def report_load_path(output: Output, net: Structure) -> None:
    names = net.member_name
    events = [
        PathEvent("slack", names[k : k + 500], 0.01 * k, np.zeros(1), np.zeros(2), k) for k in range(800)
    ]
    events.append(PathEvent("limit", (), 9.0, np.zeros(1), np.zeros(2), 900))
    output.result(
        {"events": [event.as_dict() for event in events]}, "reached", events_table(events, output.whole)
    )


def report_plan(output: Output, net: Structure) -> None:
    found = settle_net(net)
    count = net.n_members
    ends = np.stack([np.ones(count), 1 + 1e-3 * np.arange(count)])
    made = PlanResult(
        "found", "the targets are reached", np.array([0.0, 1.0]), ("twist",), ("deg",),
        np.array([[1.0], [2.0]]), np.array([2.0]), net.member_name, ends - 1, ends, net.node_name,
        net.member_name, (), ~net.is_bar,
        np.stack([net.node_position, found.node_position]), np.stack([found.member_tension] * 2),
        np.zeros((2, 0)), np.ones(2), np.zeros(2), np.zeros((2, 1)), ((), ()),
    )  # fmt: skip
    answer = PlanAnswer(SceneCase(net, ModelRequest(())), made, None)
    output.result(answer.as_dict(), *answer.describe())


def report_infeasible_plan(output: Output, net: Structure) -> None:
    n = net.n_members
    proof = Certificate(np.zeros(3), np.arange(1.0 * n), (1, 2), 0.0, 0.0, 0.1, 0.0, 1e-15, True)
    empty = np.zeros((1, 0))
    made = PlanResult(
        "infeasible", "proved", np.zeros(1), ("twist",), ("deg",), np.array([[1.0]]), np.array([2.0]), (),
        empty, empty, net.node_name, net.member_name, (), ~net.is_bar, net.node_position[None],
        np.zeros((1, n)), empty, np.ones(1), np.zeros(1), np.zeros((1, 1)), ((),), certificate=proof,
    )  # fmt: skip
    answer = PlanAnswer(SceneCase(net, ModelRequest(())), made, None)
    output.result(answer.as_dict(), *answer.describe())


def report_control(output: Output, net: Structure) -> None:
    uses = {
        name: {
            "rest_length": [0.9, 1.0], "range": [0.5, 1.5], "motion_rate": 0.1, "peak_rate": 1e-3 * k,
            "rate": 1.0 if k % 2 else None,
        }
        for k, name in enumerate(net.member_name)
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(control_studies, "find_actuator_use", lambda study: uses)
        study: Any = SimpleNamespace(worst_draw=0)
        output.result({"actuators": uses}, "holds: ", control_studies.actuators_table(study, "net"))


def report_sweep(output: Output, net: Structure) -> None:
    keys = net.member_name[:2000]
    spread = SimpleNamespace(
        **dict.fromkeys(("least", "percent_5", "median", "mean", "percent_95", "largest"), 1.0)
    )
    chosen = [
        SimpleNamespace(
            result=SimpleNamespace(name=f"tension{k}", unit="N"), distribution=spread, indices="too few",
            correlation=np.linspace(-1, 1, 2000), strength=np.linspace(0, 1, 2000),
        )
        for k in range(4)
    ]  # fmt: skip
    failing = [SimpleNamespace(key=key, distance=0.5, failed=1.0, good=2.0) for key in keys]
    endings = [SimpleNamespace(status=f"s{k}", count=k, first=k, message="") for k in range(12)]
    worst = [SimpleNamespace(case=k, keys=dict.fromkeys(keys, 1.0), reason="largest") for k in range(3)]
    summary: Any = SimpleNamespace(
        endings=endings, failing=failing, chosen=chosen, results=SimpleNamespace(keys=keys), worst=worst
    )
    output.result({"keys": list(keys)}, "8,000 of 9,000 cases converged", *list_tables(summary))


REPORTS: dict[str, tuple[Callable[[Output, Structure], None], int]] = {  # and the rows of all their tables
    "equilibrium": (report_equilibrium, SIDE**2 + N_MEMBERS),
    "analyse": (report_analysis, SIDE**2 + N_MEMBERS + 500),
    "sensitivity": (report_sensitivity, N_MEMBERS),
    "linearize": (report_linear_model, SIDE**2),
    "load-path": (report_load_path, 801),
    "plan": (report_plan, N_MEMBERS),
    "plan, infeasible": (report_infeasible_plan, N_MEMBERS),
    "control": (report_control, N_MEMBERS),
    "sweep summary": (report_sweep, 12 + 2000 + 4 + 8000 + 3),
}


@pytest.mark.parametrize("verb", REPORTS)
def test_the_text_of_a_large_structure_is_short_and_says_how_to_see_the_rest(
    verb: str, net: Structure, capsys: pytest.CaptureFixture[str]
) -> None:
    REPORTS[verb][0](Output(False), net)
    out, err = capsys.readouterr()
    assert out.count("\n") + err.count("\n") < BELOW
    assert " more with --all, and in --json" in out
    assert len(out) < 20_000


@pytest.mark.parametrize("verb", REPORTS)
def test_all_prints_every_row(verb: str, net: Structure, capsys: pytest.CaptureFixture[str]) -> None:
    report, count = REPORTS[verb]
    report(Output(False, whole=True), net)
    out = capsys.readouterr().out
    assert count <= out.count("\n") < count + BELOW
    assert "more with --all" not in out


@pytest.mark.parametrize("verb", REPORTS)
def test_json_is_complete_with_and_without_all(
    verb: str, net: Structure, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = []
    for whole in (False, True):
        REPORTS[verb][0](Output(True, whole), net)
        printed.append(
            {key: value for key, value in json.loads(capsys.readouterr().out).items() if key != "seconds"}
        )
    assert printed[0] == printed[1]
    assert len(json.dumps(printed[0])) > 80_000


def test_the_rows_are_those_that_matter_most(net: Structure, capsys: pytest.CaptureFixture[str]) -> None:
    report_equilibrium(Output(False), net)
    nodes, members = capsys.readouterr().out.split("small: ")[1:]
    assert nodes.startswith(
        "nodes; 10 of 4,761 nodes (moved farthest), 4,751 more with --all, and in --json\n"
    )
    assert [line.split()[0] for line in nodes.splitlines()[3:13]] == [f"n{4760 - k}" for k in range(10)]
    reasons = "cables with least tension, bars with most compression"
    assert members.startswith(f"members; 10 of 9,384 members ({reasons}), 9,374 more")
    numbers = [int(line.split()[0].removeprefix(LONG)) for line in members.splitlines()[5:15]]
    assert numbers == [4000, 5000, 10, 11, 12, 9, 8, 7, 6, 5]


def test_members_with_limits_are_shown_by_what_they_use_of_them(
    net: Structure, capsys: pytest.CaptureFixture[str]
) -> None:
    most = np.where(np.arange(net.n_members) == 77, 0.5, 1e3)
    limits = replace(Limits().for_members(net.n_members), most_tension=most)
    report_equilibrium(Output(False), replace(net, limits=limits))
    members = capsys.readouterr().out.split("small: members; ")[1]
    assert members.startswith(
        "10 of 9,384 members (nearest to their limits or beyond, cables with least tension)"
    )
    numbers = [int(line.split()[0].removeprefix(LONG)) for line in members.splitlines()[5:15]]
    assert numbers == [77, 9383, 9382, 9381, 9380, 4000, 5000, 10, 11, 12]


def test_small_structures_are_printed_whole(capsys: pytest.CaptureFixture[str]) -> None:
    structure = prism()
    printed = []
    for whole in (False, True):
        report_equilibrium(Output(False, whole), structure)
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]
    assert all(name in printed[0] for name in (*structure.node_name, *structure.member_name))


def test_very_long_tables_are_not_drawn(
    net: Structure, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(LongTable, "__rich__")  # which takes 14 s for these rows
    report_equilibrium(Output(False, whole=True), net)
    assert capsys.readouterr().out.count("\n") > 14_000


def test_warnings_name_the_first_of_many_and_json_all(capsys: pytest.CaptureFixture[str]) -> None:
    names = ", ".join(f"c{k}" for k in range(4322))
    text = f"at rest length: {names}; the stiffness jumps there"
    output = Output(False)
    output.warn(text)
    said = capsys.readouterr().err
    first = ", ".join(f"c{k}" for k in range(10))
    assert said == f"warning: at rest length: {first} and 4,312 more; the stiffness jumps there\n"
    assert output.warned == [text]
    Output(False, whole=True).warn(text)
    assert capsys.readouterr().err == f"warning: {text}\n"
    Output(False).warn(few := f"at rest length: {', '.join(f'c{k}' for k in range(20))}")
    assert capsys.readouterr().err == f"warning: {few}\n"


def test_many_warnings_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    output = Output(False)
    with output.guard():
        output.warn(*(f"the input {k} is in newtons" for k in range(500)))
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == MOST_WARNINGS + 2
    assert lines[-2] == f"{500 - MOST_WARNINGS} more warnings; --json has all"
    assert len(output.warned) == 500


def test_nothing_that_is_printed_steers_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    name = "a\x1b[31m\x07\r\x9b\u202eb"
    output = Output(as_json=False)
    output.warn(f"warned of {name}")
    output.note(f"noted {name}")
    table = Table(title=f"of {name}")
    table.add_row(f"cell {name}")
    output.result({}, f"result {name}", table)
    Output(as_json=True).result({"name": name})
    out, err = capsys.readouterr()
    assert all(letter.isprintable() or letter == "\n" for letter in out + err)
    shown = r"a\x1b[31m\x07\x0d\x9b\u202eb"
    for words in (f"result {shown}", f"of {shown}", f"cell {shown}"):
        assert words in out
    for words in (f"warned of {shown}", f"noted {shown}"):
        assert words in err
