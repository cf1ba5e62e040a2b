"""Error against run time: fair problems, certified references, fronts, resumed reports, the page."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.cli.app import main
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.work_precision import scene_report
from tensegrity_codegen.studies.work_precision.library_contenders import (
    VARIANTS,
    describe_simulation,
    list_library_contenders,
)
from tensegrity_codegen.studies.work_precision.measure import (
    Contender,
    Reference,
    Row,
    Run,
    Unavailable,
    certify,
    find_fastest,
    find_front,
    measure,
    set_problem,
)
from tensegrity_codegen.studies.work_precision.peers import (
    cvode,
    mujoco_tendons,
    peer_contenders,
    scipy_ivp,
    sundials,
)
from tensegrity_codegen.studies.work_precision.report import write_report
from tensegrity_codegen.studies.work_precision.scene_report import Options
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
)
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.tables.request import ModelRequest
from tests.common_prism import POSITION, common_prism
from tests.ground_cases import make_slope
from tests.report.browser import find_browser, open_page
from tests.runtime.build import bar, cable, make_structure, prism

in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
EXAMPLES = Path(__file__).parents[2] / "tensegrity_codegen" / "scene" / "examples"


def row(name: str, error: float, seconds: float, **more: object) -> Row:
    words, ended = (name, "own", "node_position", "rk54", "tolerance"), ("ok", "", 9, 9, None, None)
    return replace(Row(*words, 1e-6, error, seconds, *ended), **more)


def test_the_front_holds_what_no_other_row_beats() -> None:
    rows = [row("a", 1e-3, 1.0), row("b", 1e-4, 2.0), row("c", 1e-3, 3.0), row("d", 1e-6, 2.5)]
    rows += [row("e", 1e-9, 0.1, status="unstable"), row("f", math.inf, 0.1)]
    assert [item.contender for item in find_front(rows)] == ["a", "b", "d"]


def test_the_advice_is_the_fastest_of_ours_that_is_good_enough() -> None:
    rows = [row("a", 1e-3, 1.0), row("b", 1e-7, 2.0), row("peer", 1e-9, 0.5, group="peer")]
    found = find_fastest(rows, 1e-6, "own")
    assert found is not None
    assert found.contender == "b"
    assert find_fastest(rows, 1e-12, "own") is None


def test_rows_come_back_from_json_and_others_are_none() -> None:
    for item in (row("a", math.inf, 1.0), row("b", 1e-3, 2.0, energy_drift=0.5)):
        assert Row.from_dict(json.loads(json.dumps(item.as_dict()))) == item
    good = row("a", 1.0, 1.0).as_dict()
    for wrong in ({"error": "soon"}, {"seconds": None}, {"n_steps": "9"}, {"setting": "1e-6"}, {"status": 0}):
        assert Row.from_dict(good | wrong) is None
    assert Row.from_dict(None) is Row.from_dict([]) is Row.from_dict({}) is None


def test_a_reference_comes_back_from_json_and_others_are_none() -> None:
    reference = Reference(np.linspace(0.0, 1.0, 12).reshape(2, 2, 3) / 3.0, "a", "b", 1e-12)
    data = json.loads(json.dumps(reference.as_dict()))
    found = Reference.from_dict(data, (2, 2, 3))
    assert found is not None
    assert np.array_equal(found.node_position, reference.node_position)
    assert (found.first, found.second, found.uncertainty) == ("a", "b", 1e-12)
    assert Reference.from_dict(data, (3, 2, 3)) is None
    for wrong in (
        {"node_position": "x"},
        {"node_position": [[1], [1, 2]]},
        {"uncertainty": "x"},
        {"first": 1},
    ):
        assert Reference.from_dict(data | wrong, (2, 2, 3)) is None
    assert Reference.from_dict(None, (2, 2, 3)) is None


def test_a_structure_at_rest_is_set_in_motion_without_stretching_its_bars() -> None:
    moving = set_problem(prism(), 1.0, 3)
    assert not moving.is_kicked  # its prestress is no self-stress: it moves by itself
    still = make_structure([[0, 0, 0], [1, 0, 0]], [bar(0, 1, 1.0)])
    kicked = set_problem(still, 1.0, 3)
    assert kicked.is_kicked
    velocity = kicked.structure.node_velocity
    assert abs(velocity[0, 0] - velocity[1, 0]) < 1e-15
    assert np.abs(velocity).max() > 1e-3


def contender(name: str, values: dict[float, float], status: str = "ok") -> Contender:
    def run(setting: float) -> Callable[[], Run]:
        return lambda: Run(np.full((2, 1, 3), values[setting]), status, "", 1, 1)

    return Contender(name, "own", "node_position", name, "tolerance", tuple(values), run)


def test_a_reference_is_the_pair_that_agrees_best() -> None:
    three = [contender("a", {1e-9: 1.0}), contender("b", {1e-9: 1.0 + 1e-12}), contender("c", {1e-9: 2.0})]
    reference = certify(three)
    assert {reference.first, reference.second} == {"a at 1e-09", "b at 1e-09"}
    assert reference.uncertainty == pytest.approx(1e-12, rel=1e-3)
    with pytest.raises(ConvergenceError, match="no two methods"):
        certify([three[0], contender("d", {1e-9: 1.0}, "unstable")])


def test_the_error_of_a_run_that_did_not_come_to_its_end_is_infinite() -> None:
    reference = Reference(np.zeros((3, 2, 3)), "", "", 0.0)
    assert reference.error(np.zeros((2, 2, 3))) == math.inf
    assert reference.error(np.full((3, 2, 3), np.nan)) == math.inf
    assert reference.error(np.full((3, 2, 3), 0.5)) == 0.5


def still_going(structure: Structure) -> NDArray[np.float64]:
    """Return node positions after 0.2 s by our own rk853."""
    request = ModelRequest(("acceleration", "member_tension", "kinetic_energy", "total_energy"))
    model = build_library(structure, replace(request, integrators=("rk853",))).load()
    return simulate(
        model, 0.2, samples=3, method="rk853", rtol=1e-11, stepping=Stepping(atol=1e-12)
    ).node_position


def sprung() -> Structure:
    members = [bar(0, 1, 1.05, 400.0), cable(1, 2, 0.9), cable(0, 2, 1.0), cable(2, 3, 0.5)]
    position = [[0, 0, 0], [1, 0, 0.1], [0.3, 0.9, 0], [0.4, 0.9, 0.9]]
    return make_structure(
        position, members, anchored={3: "xyz", 0: "z"}, gravity=(0, 0, -9.81), load={1: (0.5, 0, 0)}
    )


@pytest.mark.peers
def test_mujoco_moves_as_our_model_does() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    structure = sprung()
    problem = set_problem(structure, 0.2, 3)
    makers = dict(mujoco_tendons.contenders(problem))
    place = makers["MuJoCo RK4"]().run(1e-4)().node_position
    assert np.abs(place - still_going(structure)).max() < 1e-8


@pytest.mark.peers
def test_mujoco_moves_rigid_bars_as_bodies() -> None:
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    problem = set_problem(common_prism(), 5.0, 3)
    place = dict(mujoco_tendons.contenders(problem))["MuJoCo RK4"]().run(2e-4)().node_position
    assert np.abs(place[-1] - POSITION[-1].reshape(6, 3)).max() < 1e-6


def two_bars() -> Structure:
    """Return two bars that meet, the first on an anchor; a third with an end that slides on a plane."""
    members = [bar(0, 1, 1.0), bar(1, 2, np.sqrt(2.0)), bar(4, 3, np.sqrt(1.25))]
    members += [cable(2, 0, 1.5), cable(2, 3, 0.9), cable(1, 3, 1.1), cable(4, 0, 1.8), cable(4, 5, 0.3)]
    position = [[0, 0, 0], [1, 0, 0], [1, 1, 1], [0, 1.5, 1], [0, 2, 0], [0.0, 2.0, 0.7]]
    structure = make_structure(
        position, members, anchored={0: "xyz", 4: "z"}, gravity=(0, 0, -9.81),
        load={1: (0.5, 0, 3.0), 3: (0.0, 2.0, 1.0), 5: (1.0, 0.0, 0.0)}, mass=[0.0, 1.0, 0.7, 0.4, 0.6, 0.5],
    )  # fmt: skip
    own = np.where(structure.is_bar, 0.8, 0.0)
    return structure.with_changes(member_mass=own)


@pytest.mark.peers
def test_mujoco_moves_elastic_bars_as_bodies_at_anchors_under_loads() -> None:
    """As our formulation with rigid bars does; as springs their mass is not possible."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    structure = two_bars()
    problem = set_problem(structure, 0.3, 3)
    own = dict(list_library_contenders(problem, flags="reference", compiler=None))[
        "rigid_bar, all bars, rk853"
    ]()
    makers = dict(mujoco_tendons.contenders(problem))
    place = makers["MuJoCo (rigid bars) RK4"]().run(3e-4)().node_position
    assert np.abs(place[-1] - place[0]).max() > 0.1
    assert np.abs(place - own.run(1e-11)().node_position).max() < 1e-6
    with pytest.raises(Unavailable, match="no mass of its own"):
        makers["MuJoCo RK4"]()


def test_bodies_in_a_loop_and_without_mass_are_not_possible_in_mujoco() -> None:
    loop = make_structure([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [bar(0, 1, 1.0), bar(1, 2, 1.4), bar(2, 0, 1.0)])
    for structure, why in (
        (loop, "loop"),
        (two_bars().with_changes(node_mass=np.zeros(6), member_mass=np.zeros(8)), "without mass"),
    ):
        with pytest.raises(Unavailable, match=why):
            mujoco_tendons.write_model(structure, "RK4", structure.is_bar)


@pytest.mark.peers
def test_cvode_itself_moves_as_our_model_does() -> None:
    """Without damping accelerations take no velocity; with damping and an input both and more."""
    pytest.importorskip("sksundae", reason="scikit-sundae is not installed")
    for structure in (sprung(), sprung().with_changes(damping=np.full(4, 0.3))):
        place = still_going(structure)
        for name, make in cvode.contenders(set_problem(structure, 0.2, 3)):
            made = make()
            run = made.run(1e-9)()
            assert np.abs(run.node_position - place).max() < 1e-6, name
            assert 0 < run.n_steps <= run.n_evaluations
    problem = set_problem(load_nodes(EXAMPLES / "prism12.toml"), 0.01, 3)
    names = {"CVODE (C; BDF, Newton, dense LU)", "CVODES (CasADi; Adams, functional iteration)"}
    found = []
    for name, make in peer_contenders(problem):
        if name in names:
            made = make()
            made.prepare(1e-9)
            found.append(made.run(1e-9)().node_position)
    assert np.ptp(found, axis=0).max() < 1e-8
    assert len(found) == 2


@pytest.mark.peers
def test_a_run_of_cvode_that_does_not_come_to_its_end_is_stated(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("sksundae", reason="scikit-sundae is not installed")
    stiff = sprung().with_changes(spring_constant=np.array([1e36, 1.0, 1.0, 1.0]))
    make = dict(cvode.contenders(set_problem(stiff, 0.2, 2)))["CVODE (C; Adams, fixed point)"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cvode, "MAX_STEPS", 1000)
        run = make().run(1e-9)()
    assert run.status == "failed"
    assert "CVODE returned -" in run.message
    assert "".join(capfd.readouterr()) == ""


def test_a_missing_sundials_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cvode.importlib.util, "find_spec", lambda name: None)
    cvode._load_cvode.cache_clear()
    _, make = next(iter(cvode.contenders(set_problem(sprung(), 0.2, 3))))
    with pytest.raises(Unavailable, match="scikit-sundae"):
        make()


def test_sundials_moves_as_our_model_does_with_every_setting() -> None:
    structure = sprung()
    problem = set_problem(structure, 0.2, 3)
    makers = {**dict(sundials.contenders(problem)), **dict(sundials.usual_contenders(problem))}
    assert {name.split()[0] for name in makers} == {"CVODES", "IDAS"}
    for words in (
        "Adams, functional",
        "BDF, functional",
        "Adams, Newton",
        "BDF, Newton, dense",
        "IDAS (CasADi; sp",
    ):
        assert any(words in name for name in makers), words
    place = still_going(structure)
    for name, make in makers.items():
        made = make()
        made.prepare(1e-9)
        assert np.abs(made.run(1e-9)().node_position - place).max() < 1e-6, name


def test_other_programs_move_scenes_with_actuators() -> None:
    structure = load_nodes(EXAMPLES / "prism12.toml")
    assert structure.inputs
    problem = set_problem(structure, 0.01, 3)
    for usual, names in (
        (True, ("CVODES (CasADi)", "SciPy DOP853")),
        (
            False,
            ("CVODES (CasADi; Adams, functional iteration)", "IDAS (CasADi; sparse QR)", "SciPy VODE (BDF)"),
        ),
    ):
        makers = dict(peer_contenders(problem, usual=usual))
        found = []
        for name in names:
            made = makers[name]()
            made.prepare(1e-7)
            found.append(made.run(1e-7)().node_position)
        assert np.ptp(found, axis=0).max() < 1e-8


@pytest.mark.parametrize("name", scipy_ivp.SOLVERS)
def test_scipy_stops_where_accelerations_are_not_finite(name: str) -> None:
    def derivative(t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
        if t > 0.1:
            raise NonFiniteError("not finite", where="acceleration")
        return -x

    with pytest.raises(NonFiniteError):
        scipy_ivp.SOLVERS[name](derivative, np.ones(2), np.linspace(0.0, 1.0, 3), 1e-6)


def test_settings_of_a_program_that_are_clearly_slower_are_given_up(tmp_path: Path) -> None:
    """After three tolerances one ends that takes twice the time of another setting for no less error."""
    structure = load_nodes(EXAMPLES / "two_nodes.toml")
    problem = set_problem(structure, 0.1, 2)
    reference = Reference(np.zeros((2, 2, 3)), "a", "b", 0.0)

    def made(name: str, seconds: float, group: str = "peer") -> Contender:
        return replace(contender(name, dict.fromkeys((0.1, 0.01, 1e-3, 1e-4, 1e-5), seconds)), group=group)

    contenders = [
        made("CVODES (a)", 1.0),
        made("CVODES (b)", 3.0),
        made("IDAS (a)", 3.0),
        made("ours", 9.0, "own"),
    ]
    journal = Journal(tmp_path / "journal.jsonl", "key")
    measured = scene_report._Measured(
        problem, Options(longest=99.0), reference, journal, lambda fraction: None
    )

    def take(problem: object, contender: Contender, setting: float, reference: Reference) -> Row:
        seconds = float(contender.run(setting)().node_position.max())
        return row(contender.name, 1e-6, seconds, group=contender.group, setting=setting)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene_report, "_measure", take)
        rows = measured.measure_all(contenders)
    counts = {name: sum(item.contender == name for item in rows) for name in (c.name for c in contenders)}
    assert counts == {"CVODES (a)": 5, "CVODES (b)": 3, "IDAS (a)": 5, "ours": 5}


NAMES = ["node_position, rk853", "rigid_bar, corrected, rk54", "node_distance, rk4", "simulate, auto"]


@pytest.mark.parametrize("name", NAMES)
def test_simulate_repeats_a_recommended_run(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run with the options and keys that a report states has the same positions."""
    structure = load_nodes(EXAMPLES / "prism.toml")
    problem = set_problem(structure, 0.05, 3)
    made = dict(list_library_contenders(problem, flags="reference", compiler=None))[name]()
    setting = sorted(made.settings)[len(made.settings) // 2]
    measured = row(made.name, 0.0, 1.0, formulation=made.formulation, method=made.method)
    text = describe_simulation(replace(measured, kind=made.kind, setting=setting), problem.t_end, "reference")
    words, _, keys = text.removesuffix(" under [model]").partition(", with ")
    scene = tmp_path / "prism.toml"
    first, *rest = (EXAMPLES / "prism.toml").read_text(encoding="utf-8").split("[model]", 1)
    lines = keys.replace(", options", "\noptions").replace(", emitter", "\nemitter")
    scene.write_text(f"{first}[model]\n{lines}\n{rest[0]}", encoding="utf-8")
    verb, *options = words.split()
    out = tmp_path / "motion.npz"
    with pytest.raises(SystemExit) as caught:
        main([verb, str(scene), *options, "--samples", "3", "--out", str(out)])
    assert not caught.value.code, capsys.readouterr().err
    with np.load(out) as data:
        assert np.abs(data["node_position"] - made.run(setting)().node_position).max() < 1e-13
    assert set(VARIANTS) >= {made.formulation}


def test_short_runs_are_repeated_and_failed_ones_are_not() -> None:
    calls = []

    def run(setting: float) -> Callable[[], Run]:
        calls.append(setting)
        return lambda: Run(np.zeros((1, 1, 3)), "unstable" if setting > 1 else "ok", "", 1, 1)

    made = Contender("x", "own", "", "", "tolerance", (1.0,), run)
    measure(made, 0.5)
    assert len(calls) > 5
    calls.clear()
    measure(made, 2.0)
    assert len(calls) == 1


@pytest.mark.thorough
@in_browser
def test_a_report_is_written_resumed_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    structure = load_nodes(EXAMPLES / "two_nodes.toml")
    options = Options(flags="reference", peers=False, longest=0.05)
    made = write_report([structure], tmp_path, t_end=0.2, samples=3, options=options)
    data = json.loads(made.data.read_text())
    rows = data["scenes"][0]["rows"]
    assert {r["method"] for r in rows} >= {"rk4", "rk54", "rk853", "auto"}
    assert min(r["error"] for r in rows if r["error"] is not None) < 1e-10
    again = write_report([structure], tmp_path, t_end=0.2, samples=3, options=options, overwrite=True)
    assert [r.seconds for r in again.scenes[0].rows] == [r.seconds for r in made.scenes[0].rows]
    (journal,) = (tmp_path / "journal").iterdir()
    lines = journal.read_text().splitlines()
    spoiled = json.loads(lines[1])
    spoiled["value"]["seconds"] = "soon"
    journal.write_text("\n".join([lines[0], json.dumps(spoiled), *lines[2:]])[:-9])  # and a torn last line
    monkeypatch.setattr(scene_report, "certify", None)  # the reference is in the journal
    healed = write_report([structure], tmp_path, t_end=0.2, samples=3, options=options, overwrite=True)
    changed = [
        a.contender
        for a, b in zip(made.scenes[0].rows, healed.scenes[0].rows, strict=False)
        if a.seconds != b.seconds
    ]
    assert 1 <= len(changed) <= 2
    assert len(made.csv.read_text().splitlines()) >= len(rows)
    shown = open_page(made.html, 1200)
    assert shown["console"] == []
    assert shown["lost_links"] == shown["doubled_ids"] == shown["outside"] == []
    assert shown["figures"] == shown["drawings_shown"] + shown["images_shown"] >= 1
    assert shown["tables_shown"] == shown["tables"] >= 3  # long ones a second time, folded


@pytest.mark.thorough
def test_structures_on_the_ground_are_measured_by_our_own_methods(tmp_path: Path) -> None:
    """A block that slips on a slope; the other programs have no such contact."""
    slope, _ = make_slope(np.radians(30.0))
    made = write_report([slope], tmp_path, t_end=0.1, samples=3, options=Options())
    (scene,) = made.scenes
    methods = {row.method for row in scene.rows if row.status == "ok" and row.error < 1e-6}
    assert {"rk54", "rk853", "radau"} <= methods
    assert {row.group for row in scene.rows} == {"own"}
    assert scene.reference.uncertainty < 1e-10


def test_no_peer_has_the_law_of_our_ground() -> None:
    slope, _ = make_slope(np.radians(30.0))
    makers = list(peer_contenders(set_problem(slope, 0.1, 3)))
    assert len(makers) > 3
    for _, make in makers:
        with pytest.raises(Unavailable, match="law of friction"):
            make()


def test_no_peer_has_members_with_a_memory(tmp_path: Path) -> None:
    """It would be called wrong, for the motion of members that do not yield."""
    text = (EXAMPLES / "two_nodes.toml").read_text(encoding="utf-8")
    scene = tmp_path / "scene.toml"
    scene.write_text(text.replace('kind = "cable"', 'kind = "cable"\nyield_force = 20'), encoding="utf-8")
    for usual in (True, False):
        for _, make in peer_contenders(set_problem(load_nodes(scene), 0.1, 3), usual=usual):
            with pytest.raises(Unavailable, match="yield or relax"):
                make()


def test_wrong_times_and_scenes_of_bodies_are_refused(tmp_path: Path) -> None:
    structure = load_nodes(EXAMPLES / "two_nodes.toml")
    for t_end, samples in ((0.0, 3), (math.nan, 3), (1.0, 1)):
        with pytest.raises(InvalidValueError):
            write_report([structure], tmp_path, t_end=t_end, samples=samples, options=Options())
    assert not list(tmp_path.iterdir())
    with pytest.raises(FormulationError, match="nodes and members"):
        load_nodes(EXAMPLES / "lin_prism.toml")
