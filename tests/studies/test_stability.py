"""Stiff and extreme cases: what they are, who is held to what, and that nothing hangs."""

import json
import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability import methods, report
from tensegrity_codegen.studies.stability.cases import (
    Case,
    as_springs,
    find_snap,
    generate_cases,
    is_essential,
)
from tensegrity_codegen.studies.stability.extended import certify_extended
from tensegrity_codegen.studies.stability.judge import Limits, certify_case, is_agreed, judge, judge_peer
from tensegrity_codegen.studies.stability.methods import CaseModels, Ending, run_own, values_of
from tensegrity_codegen.studies.stability.report import StabilityReport, run_case, write_stability
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError
from tensegrity_codegen.system.forked import can_fork
from tests.cases import thorough
from tests.common_prism import common_prism
from tests.ground_cases import make_slope
from tests.report.browser import find_browser, open_page
from tests.runtime.build import prism

in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
EXAMPLES = Path(__file__).parents[2] / "tensegrity_codegen" / "scene" / "examples"


def ending(value: float, status: str = "ok") -> Ending:
    return Ending(status, "", along_x(value, value), 0.1)


def along_x(place: float, speed: float) -> Any:
    """Two states of six nodes on the x axis, with speeds along it."""
    return np.tile(np.concatenate([np.tile([place, 0.0, 0.0], 6), np.tile([speed, 0.0, 0.0], 6)]), (2, 1))


def case(**more: Any) -> Case:
    return Case("group", "name", prism(), 1.0, **{"rtol": 1e-3, **more})


def models(structure: Structure) -> CaseModels:
    return CaseModels(structure, compiler=None, flags="reference")


@pytest.mark.parametrize("structure", [prism(), common_prism()], ids=["springs", "rigid bars"])
def test_cases_cover_what_breaks_integrators(structure: Structure) -> None:
    cases = list(generate_cases(structure, 1.0))
    groups = Counter(item.group for item in cases)
    others = ("mass ratio", "damping", "tolerance", "coincident nodes", "slack", "impact", "offset", "step")
    assert set(groups) >= {*others, "snap-through"}
    assert groups["bad numbers"] == 3
    stiff = [item for item in cases if item.group == "stiffness ratio"]
    assert [item.is_rigid for item in stiff].count(False) == 12
    assert any(item.is_rigid for item in cases)


def test_two_groups_of_bars_are_a_thousand_times_as_stiff_as_each_other() -> None:
    (mixed,) = (item for item in generate_cases(prism(), 1.0) if item.group == "two stiff groups")
    mu = mixed.structure.mu[mixed.structure.is_bar]
    assert sorted(mu / mu.min()) == pytest.approx([1.0, 1.0, 1e3])
    tension = as_springs(prism()).static_tension()
    assert np.abs(mixed.structure.static_tension() - tension).max() < 1e-6 * np.abs(tension).max()


def test_cases_vary_the_ground() -> None:
    slope, _ = make_slope(np.radians(30.0))
    items = {item.name: item.structure for item in generate_cases(slope, 0.1) if item.group == "ground"}
    grounds = [structure.ground for structure in items.values()]
    assert [g and g.stiffness for g in grounds] == [1e3, 1e7, 1e9, *[1e5] * 4]
    assert [g and g.friction for g in grounds] == [*[0.5] * 3, 0.0, 0.05, 1.0, 0.5]
    grazing = items["a node grazes it at one length a second"]
    assert grazing.ground is not None
    assert abs(grazing.node_position[0] @ grazing.ground.normal) < 1e-15
    assert abs(grazing.node_velocity[0] @ grazing.ground.normal) < 1e-15
    assert np.linalg.norm(grazing.node_velocity[0]) == pytest.approx(slope.member_length().mean())
    assert not [item for item in generate_cases(prism(), 0.1) if item.group == "ground"]


def test_every_method_with_error_control_takes_part_on_the_ground() -> None:
    """Its references know the ground: a block that starts on a slope slides."""
    slope, _ = make_slope(np.radians(30.0))
    stiffer, *_, item = (item for item in generate_cases(slope, 0.05) if item.group == "ground")
    assert certify_extended(item, 1.0) is None  # which has no ground
    made = models(slope)
    found = run_case(made, item, Limits(peers=False))
    assert {row.contender: row.verdict for row in found} == dict.fromkeys(
        ("auto", "rk853", "rk54", "tsit5", "rodas"), "survived"
    )
    assert made.of(stiffer) is made.of(item)  # one library: its numbers are run-time parameters
    assert values_of(made.of(stiffer), stiffer.structure)["ground"].tolist() == [1e3, 0.5, 1e3]


def test_stiffer_bars_keep_the_tension_that_they_have() -> None:
    start = as_springs(prism())
    stiff = [item for item in generate_cases(prism(), 1.0) if item.group == "stiffness ratio"]
    for item in stiff[:8]:  # beyond, rounding of l - l0 takes the digits
        apart = item.structure.static_tension() - start.static_tension()
        assert np.abs(apart).max() < 1e-6 * np.abs(start.static_tension()).max()


@pytest.mark.thorough
@pytest.mark.parametrize("structure", [prism(), common_prism()], ids=["springs", "rigid bars"])
def test_a_case_reaches_its_compiled_model_whole(structure: Structure) -> None:
    compiled = models(structure)
    for item in generate_cases(structure, 1.0):
        if item.expects_refusal or item.structure.damping.any():
            continue
        values = values_of(compiled.of(item), item.structure)
        tension = compiled.of(item).compute("member_tension", **values)
        expected, known = item.structure.static_tension(), ~item.structure.is_rigid
        scale = 1e-9 * np.abs(expected).max()
        assert tension[known] == pytest.approx(expected[known], rel=1e-9, abs=scale), item.name


def test_a_node_snaps_through_the_plane_of_its_neighbours() -> None:
    structure = prism()
    found = find_snap(structure)
    assert found is not None
    node, height = found
    near = {int(k) for pair in structure.connectivity if node in pair for k in pair} - {node}
    apart = structure.node_position[sorted(near)] - (structure.node_position[node] - height)
    assert abs(apart.mean(axis=0) @ height) < 1e-12  # the foot lies in their plane
    assert np.linalg.norm(height) > 0.01


def test_rigid_bars_of_a_case_are_as_long_as_their_nodes_are_apart_and_not_stretched() -> None:
    for item in generate_cases(common_prism(), 1.0):
        if item.is_rigid and np.isfinite(item.structure.node_position).all():
            rigid, ends = item.structure.is_rigid, item.structure.connectivity[item.structure.is_rigid]
            length = item.structure.member_length()[rigid]
            assert length == pytest.approx(item.structure.rest_length[rigid], rel=1e-15)
            r, v = (x[ends[:, 0]] - x[ends[:, 1]] for x in (item.structure.node_position, velocity(item)))
            assert np.abs((r * v).sum(axis=1)).max() <= 1e-12 * max(1.0, np.abs(v).max()), item.name


def velocity(item: Case) -> Any:
    return item.structure.node_velocity


def test_a_result_called_good_is_held_to_ten_times_its_tolerance() -> None:
    truth = certify_case(case(), [lambda rtol: ending(1.0), lambda rtol: ending(1.0 + 1e-9)])
    assert truth is not None
    assert judge(case(), ending(1.0 + 5e-3), truth).verdict == "survived"
    off = judge(case(), ending(1.0 + 2e-2), truth)
    assert (off.verdict, off.rule, off.error) == ("wrong", "plain", pytest.approx(20.0, rel=0.01))
    assert judge(case(), ending(math.nan), truth).verdict == "wrong"
    assert judge(case(), ending(2.0, "unstable"), truth).verdict == "stopped"
    assert (
        judge(case(step=0.1), ending(1.0 + 9e-3), truth).verdict == "survived"
    )  # a hundredth, without tolerance
    assert judge(case(step=0.1), ending(1.0 + 2e-2), truth).verdict == "wrong"
    assert judge(case(expects_refusal=True), ending(1.0), None).verdict == "wrong"
    assert judge(case(), ending(1.0), None).verdict == "unchecked"


def test_other_programs_are_held_to_their_tolerance_or_a_hundredth_of_the_length() -> None:
    length = float(prism().member_length().mean())

    def find(rtol: float, off: float) -> str:
        truth = certify_case(case(rtol=rtol), [lambda rtol: ending(1.0), lambda rtol: ending(1.0)])
        state = along_x(1.0 + off, 0.0)[:, :18]
        return judge_peer(case(rtol=rtol), replace(ending(1.0), state=state), truth).verdict

    assert find(1.0, 5.0) == find(1e-6, 0.9e-2 * length) == "survived"
    assert find(1.0, 20.0) == find(1e-6, 1.1e-2 * length) == "wrong"


def test_essential_cases_are_run_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[Case] = []

    def record(work: Any, cases: Any, **more: Any) -> Iterator[Any]:
        order.extend(cases)
        yield from ()

    monkeypatch.setattr(report, "run_pieces", record)
    write_stability(
        [prism()], tmp_path, t_end=0.1, limits=Limits(peers=False), compiler=None, flags="reference"
    )
    first = [f"{item.group}: {item.name}" for item in order if is_essential(item)]
    assert first == [f"{item.group}: {item.name}" for item in order[: len(first)]]
    wanted = ("stiffness ratio: 1e+06", "stiffness ratio: rigid", "slack: every cable slack")
    assert set(first) > set(wanted)
    assert {item.group for item in order[: len(first)]} >= {"impact", "snap-through"}
    assert "tolerance: rtol 1e-300" not in first


@pytest.mark.parametrize(
    ("name", "rtol", "wanted"),
    [
        ("1e+03", 1e-6, {"rk853", "radau"}),
        *thorough(("1e+01", 1e-6, {"rk853"}), ("1e+01", 1.0, {"rk54"}), ("rigid", 1e-6, {"rk853"})),
    ],
)
def test_the_method_auto_has_the_integrators_that_simulate_would_compile(
    name: str, rtol: float, wanted: set[str]
) -> None:
    """For bars ten times as stiff as cables that is rk853, for a thousand times radau too."""
    compiled = models(prism())
    (item,) = (item for item in generate_cases(prism(), 0.1) if item.name == name)
    model = compiled.of(replace(item, rtol=rtol), "auto")
    assert {spec.name for spec in model.manifest.integrators} == wanted
    everything = {spec.name for spec in compiled.of(item, "rk54").manifest.integrators}
    assert everything >= {"rk853", "rk54", "rk4"}


def test_velocities_are_held_to_what_the_run_says_and_positions_never() -> None:
    truth = certify_case(case(), [lambda rtol: ending(1.0), lambda rtol: ending(1.0)])
    state = along_x(1.0, 1.05)
    told = judge(case(), Ending("ok", "", state, 0.1, speed_bound=0.05), truth)
    assert (told.verdict, told.rule) == ("survived", "told")
    assert judge(case(), Ending("ok", "", state, 0.1, speed_bound=0.03), truth).verdict == "wrong"
    assert judge(case(), Ending("ok", "", state, 0.1), truth).verdict == "wrong"
    turned = Ending("ok", "", along_x(1.05, 1.0), 0.1, speed_bound=0.05)
    assert judge(case(), turned, truth).verdict == "wrong"
    again = [lambda rtol: ending(1.0), lambda rtol: Ending("ok", "", state, 0.1, speed_bound=0.05)]
    assert certify_case(case(), again) is None  # a reference has no freedom of its own
    alone = certify_case(case(), again, positions_only=True)
    assert alone is not None
    assert not alone.knows_speed
    assert judge(case(), Ending("ok", "", state, 0.1), alone).rule == "positions"


def test_tensions_are_held_to_what_errors_of_states_come_to() -> None:
    item = Case("group", "name", prism(), 1.0, rtol=1e-6)
    places = item.structure.coordinate_node_axis
    still = np.zeros((2, 2 * len(places)))
    still[:, : len(places)] = item.structure.node_position[places[:, 0], places[:, 1]]
    pull = np.repeat(item.structure.static_tension()[None], 2, axis=0)
    good = Ending("ok", "", still, 0.1, tension=pull)
    truth = certify_case(item, [lambda rtol: good, lambda rtol: good])
    assert judge(item, good, truth).tension_error == 0.0
    for off, verdict in ((1e-3, "survived"), (0.1, "wrong")):  # a cable of 100 N/m
        changed = pull.copy()
        changed[1, -1] += off
        assert judge(item, replace(good, tension=changed), truth).verdict == verdict, off


@pytest.mark.thorough
def test_extended_precision_agrees_with_two_methods_where_these_do() -> None:
    (item,) = (item for item in generate_cases(prism(), 0.02) if item.name == "1e+04")
    compiled = models(prism())
    truth = certify_case(item, [partial(run, compiled, item, method) for method in ("rk853", "rk54")])
    extended = certify_extended(item, 20.0)
    assert truth is not None
    assert extended is not None
    assert is_agreed(item, truth.state, np.abs(truth.state - extended.state))
    assert truth.tension is not None
    assert extended.tension is not None
    assert extended.tension == pytest.approx(truth.tension, rel=1e-6, abs=1e-6)


def test_a_reference_needs_two_methods_that_agree() -> None:
    assert certify_case(case(), [lambda rtol: ending(1.0), lambda rtol: ending(1.0, "over time")]) is None
    assert certify_case(case(), [lambda rtol: ending(1.0), lambda rtol: ending(1.1)]) is None
    sharper = certify_case(case(), [lambda rtol: ending(1.0), lambda rtol: ending(1.0 + 20 * rtol)])
    assert sharper is not None
    assert sharper.apart.max() < 1e-3


def test_a_run_ends_when_its_time_is_up() -> None:
    stiff = [item for item in generate_cases(prism(), 2.0) if item.name == "1e+08"]
    model = models(prism()).of(stiff[0])
    ended = run_own(model, stiff[0], "rk54", 1e-6, 0.5)
    assert ended.status == "over time"


@pytest.mark.skipif(not can_fork(), reason="this system makes no processes by fork")
def test_a_peer_that_hangs_crashes_or_raises_is_an_ending(monkeypatch: pytest.MonkeyPatch) -> None:
    def hang(*_: Any) -> Any:
        time.sleep(600.0)

    def crash(*_: Any) -> Any:
        import os

        os._exit(1)

    def fail(*_: Any) -> Any:
        raise ZeroDivisionError("a peer's own way")

    for function, patience, status in (
        (hang, 0.1, "over time"),
        (crash, 60.0, "crashed"),
        (fail, 60.0, "error"),
    ):
        monkeypatch.setattr(methods, "_run", function)
        assert methods.run_peer(case(), "any", patience).status == status


def test_scipy_survives_the_scene_as_it_is() -> None:
    structure = load_nodes(EXAMPLES / "two_nodes.toml")
    first = next(iter(generate_cases(structure, 0.1)))
    ended = methods.run_peer(first, "SciPy DOP853", 60.0)
    assert ended.status == "ok", ended.message


@pytest.mark.thorough
@in_browser
def test_the_page_of_a_small_scene(tmp_path: Path) -> None:
    structure = load_nodes(EXAMPLES / "two_nodes.toml")
    limits = Limits(run=2.0, reference=2.0, peers=False)
    made = write_stability([structure], tmp_path, t_end=0.1, limits=limits, compiler=None, flags="reference")
    rows = json.loads(made.data.read_text())["scenes"][structure.name]
    verdicts = {(row["case"], row["contender"]): row["verdict"] for row in rows}
    assert verdicts["the scene", "rk853"] == "survived"
    for row in rows:
        if row["case"] == "two joined nodes in one place" or row["case"].endswith(("nan", "inf")):
            assert row["verdict"] == "stopped", row
    shown = open_page(made.html, 1200)
    assert shown["console"] == []
    assert shown["lost_links"] == shown["doubled_ids"] == []
    assert shown["tables_shown"] >= 1
    narrow = open_page(made.html, 400)
    assert narrow["content_width"] <= narrow["width"]  # wide tables scroll in their own boxes
    assert narrow["outside"] == []


@pytest.mark.thorough
def test_rigid_bars_take_part() -> None:
    compiled = models(common_prism())
    for item in generate_cases(common_prism(), 0.2):
        if item.group == "damping":
            both = [partial(run, compiled, item, method) for method in ("rk853", "rk54")]
            truth = certify_case(item, both)
            assert truth is not None, item.name
            verdict = judge(item, run(compiled, item, "radau", item.rtol), truth).verdict
            assert verdict == "survived" or (item.name.startswith("1000") and verdict == "stopped")


def run(compiled: CaseModels, item: Case, method: str, rtol: float) -> Ending:
    return run_own(compiled.of(item), item, method, rtol, 5.0)


def test_wrong_times_are_refused(tmp_path: Path) -> None:
    for t_end, limit in ((0.0, 1.0), (1.0, math.nan)):
        with pytest.raises(InvalidValueError):
            write_stability(
                [prism()], tmp_path, t_end=t_end, limits=Limits(run=limit), compiler=None, flags="reference"
            )


def write_few(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, overwrite: bool = False, **limits: Any
) -> StabilityReport:
    """Write the page of three cases of the smallest scene."""
    structure = load_nodes(EXAMPLES / "two_nodes.toml")
    monkeypatch.setattr(report, "generate_cases", lambda *words: list(generate_cases(*words))[:3])
    given = Limits(run=5.0, reference=5.0, peers=False, **limits)
    return write_stability(
        [structure], folder, t_end=0.1, limits=given, compiler=None, flags="reference", overwrite=overwrite
    )


def test_what_the_budget_does_not_allow_is_listed_as_not_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = write_few(tmp_path, monkeypatch, total=1e-6)
    data = json.loads(made.data.read_text())
    assert {row["verdict"] for row in data["scenes"]["two_nodes"]} == {"not run"}
    assert "budget" in data["scenes"]["two_nodes"][0]["message"]
    assert len(data["not_run"]) == len(made.cases_not_run) == 3
    assert "Not run" in made.html.read_text()
    made = write_few(tmp_path, monkeypatch, overwrite=True)  # the same command runs them
    assert made.cases_not_run == ()


def test_finished_cases_are_taken_from_the_journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = write_few(tmp_path, monkeypatch)
    (journal,) = (tmp_path / "journal").iterdir()
    lines = journal.read_text().splitlines()
    assert len(lines) == 3
    torn = lines[1].replace('"seconds": ', '"seconds": "soon')  # no JSON
    wrong = json.loads(lines[2])
    wrong["value"][0]["seconds"] = "soon"  # a text where a number belongs
    journal.write_text("\n".join([lines[0], torn, json.dumps(wrong)]))

    def count(models: Any, item: Case, limits: Any) -> Any:
        with (tmp_path / "ran").open("a") as file:
            file.write(f"{item.group}: {item.name}\n")
        return run_case(models, item, limits)

    monkeypatch.setattr(report, "run_case", count)
    second = write_few(tmp_path, monkeypatch, overwrite=True)
    again = (tmp_path / "ran").read_text().splitlines()
    assert sorted(again) == sorted(json.loads(line)["name"] for line in lines[1:])
    kept = json.loads(lines[0])["name"]
    before = [row for row in first.outcomes["two_nodes"] if f"{row.group}: {row.case}" == kept]
    after = [row for row in second.outcomes["two_nodes"] if f"{row.group}: {row.case}" == kept]
    assert before == after  # the time it took too


def test_two_scenes_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DuplicateNameError):
        write_stability(
            [prism(), prism()], tmp_path, t_end=0.1, limits=Limits(), compiler=None, flags="reference"
        )
