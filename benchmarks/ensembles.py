"""A thousand motions of a prism in batches, beside MuJoCo and SUNDIALS, each at its cheapest for one error.

python benchmarks/ensembles.py [--count 1000] [--error 1e-5] [--seconds 1.0] [--peers 4] [--ratio 1e3]
                               [--write]

The prism of the examples, bars `ratio` times as stiff as cables; their mass is put to the nodes, since
springs have none in MuJoCo. Motions start near the equilibrium, nodes displaced by 5 mm and moving at 0.1 m/s
at random, bars at their lengths. The error is the largest of all node coordinates at the end and of all
motions, against Runge-Kutta 8(5,3) at a tolerance of 1e-11; how far Runge-Kutta 4 with short steps is off is
shown. rigid_bar takes bars as rigid, or corrects that by how far their forces strain them. Peers run a few of
the motions, one after the other, and count as if the others took as long; MuJoCo has bars as springs and as
rigid bodies, SUNDIALS is CVODE itself in C, and CVODES and IDAS behind CasADi. CPU seconds of one core.
"""

import argparse
import contextlib
import itertools
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from harness.turns import EXAMPLES, draw_bars, find_about, publish, table_text
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.analyses import equilibrium_quantities
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tensegrity_codegen.runtime.integrate.batch_integration import integrate_batch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.motion_input import make_consistent
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import stiffen_bars
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Unavailable, measure
from tensegrity_codegen.studies.work_precision.peers import cvode, mujoco_tendons, sundials
from tensegrity_codegen.tables.request import ModelRequest

FloatArray = NDArray[np.float64]

SCENE = EXAMPLES / "prism.toml"
PAGE = "sweep_measured.md"
HEADS = ("way", "setting", "CPU, each [ms]", "error [m]", "motions", "times over ours")
DISPLACED, MOVING = 5e-3, 0.1  # [m], [m/s]
ROUNDS = 5
SECOND_STEP = 1e-5  # [s], of the second reference, at a ratio of 1e3
FORMULATIONS: dict[str, tuple[str, dict[str, str]]] = {
    "node_position": ("node_position", {}),
    "rigid_bar": ("rigid_bar", {"bars": "all"}),
    "rigid_bar, corrected": ("rigid_bar", {"bars": "all", "correction": "first_order"}),
}
METHODS = ("rk4", "rk54", "rk853")
OWN_STEPS = tuple(1e-2 / 1.15**k for k in range(64))
OWN_TOLERANCES = tuple(10.0 ** (-1.0 - k / 4) for k in range(32))
PEER_STEPS = tuple(10.0 ** (-2.0 - k / 8) for k in range(28))
PEER_TOLERANCES = tuple(10.0 ** (-2.0 - k / 4) for k in range(32))


@dataclass(frozen=True)
class Line:
    """One row of the table: who, at which setting, CPU seconds a motion, error [m] over how many motions."""

    name: str
    setting: float
    seconds: float
    error: float
    count: int


def make_structure(ratio: float = 1e3) -> Structure:
    """Return the prism at its equilibrium, the mass of bars at their ends, bars `ratio` times as stiff."""
    structure = load_nodes(SCENE)
    none = np.zeros(structure.n_members)
    structure = structure.with_changes(node_mass=structure.lumped_mass, member_mass=none)
    structure = stiffen_bars(structure, ratio * structure.spring_constant[~structure.is_bar].max())
    request = ModelRequest(())
    wanted = request.wanting(*equilibrium_quantities(structure, request))
    found = find_equilibrium(build_library(structure, wanted).load())
    return structure.with_changes(node_position=found.node_position)


def make_starts(structure: Structure, count: int) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (count, n_nodes, 3) that keep the bars' lengths and what is held."""
    rng = np.random.default_rng(0)
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    ends = structure.connectivity[structure.is_bar]
    length = structure.member_length()[structure.is_bar]
    places, speeds = [], []
    for _ in range(count):
        place = structure.node_position + np.where(free, DISPLACED * rng.standard_normal(free.shape), 0.0)
        for _ in range(8):
            jacobian, now = _lengths(place, ends, free)
            place[free] -= np.linalg.lstsq(jacobian, now - length, rcond=None)[0]
        jacobian, _ = _lengths(place, ends, free)
        speed = np.where(free, MOVING * rng.standard_normal(free.shape), 0.0)
        speed[free] -= np.linalg.lstsq(jacobian, jacobian @ speed[free], rcond=None)[0]
        places.append(place)
        speeds.append(speed)
    return np.array(places), np.array(speeds)


def _lengths(
    place: FloatArray, ends: NDArray[np.int64], free: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the lengths of the bars and their derivatives to the free coordinates."""
    vector = place[ends[:, 0]] - place[ends[:, 1]]
    length = np.linalg.norm(vector, axis=1)
    rows = np.zeros((len(ends), *free.shape))
    rows[np.arange(len(ends)), ends[:, 0]] = vector / length[:, None]
    rows[np.arange(len(ends)), ends[:, 1]] = -vector / length[:, None]
    return rows[:, free], length


class Ensemble:
    """The motions, and what they should come to: positions of the free coordinates at the end."""

    def __init__(
        self, structure: Structure, count: int, seconds: float, compiler: str | None, ratio: float = 1e3
    ) -> None:
        self.structure, self.time, self.compiler = structure, np.array([0.0, seconds]), compiler
        self.place, self.speed = make_starts(structure, count)
        at = structure.coordinate_node_axis
        self.state = np.hstack([self.place[:, at[:, 0], at[:, 1]], self.speed[:, at[:, 0], at[:, 1]]])
        self.way = {"node_position": (self._compile("node_position"), self.state)}
        self.end = self.run("node_position", "rk853", 1e-11)[0]
        second = self.run("node_position", "rk4", SECOND_STEP / np.sqrt(ratio / 1e3))[0]
        self.apart = float(np.abs(second - self.end).max())

    def _compile(self, title: str) -> CompiledModel:
        formulation, options = FORMULATIONS[title]
        kept = ("consistent_coordinate", "consistent_velocity", "rigidity_error") if options else ()
        request = ModelRequest(
            ("acceleration", *kept),
            integrators=METHODS,
            events=("auto",),
            batch_width=8,
            formulation=formulation,
            options=options,
        )
        return build_library(self.structure, request, compiler=self.compiler, flags="native").load()

    def _prepare(self, title: str) -> tuple[CompiledModel, FloatArray]:
        """Return model and starts in a formulation, these brought onto its constraints."""
        if title not in self.way:
            model, n = self._compile(title), self.state.shape[1] // 2
            rows = [np.concatenate(make_consistent(model, x[:n], x[n:], {})) for x in self.state]
            self.way[title] = model, np.array(rows)
        return self.way[title]

    def run(self, title: str, method: str, setting: float) -> tuple[FloatArray, float]:
        """Return positions at the end (n_batch, n_coordinates), NAN where not reached, and CPU seconds."""
        model, state = self._prepare(title)
        options = RunOptions(method, setting, setting, setting if method == "rk4" else None)
        started = time.process_time()
        raw = integrate_batch(Motion(model, state, self.time), options)
        seconds = time.process_time() - started
        return raw.state[:, -1, : raw.state.shape[2] // 2], seconds

    def error(self, found: FloatArray, rows: slice = slice(None)) -> float:
        """Return the largest error of a coordinate; infinite where an end was not reached."""
        apart = np.abs(found - self.end[rows])
        return float(apart.max()) if np.isfinite(apart).all() else float("inf")

    def problem(self, k: int) -> MotionProblem:
        """Return motion k as peers read it."""
        structure = self.structure.with_changes(node_position=self.place[k], node_velocity=self.speed[k])
        return MotionProblem(structure, self.time, False)


def find_own(
    ensemble: Ensemble, title: str, method: str, settings: Sequence[float], limit: float
) -> Line | None:
    """Return the cheapest setting of one of our ways that meets the error, timed over all motions."""
    errors: list[float] = []
    for setting in settings:
        error = ensemble.error(ensemble.run(title, method, setting)[0])
        if error <= limit:
            count = len(ensemble.state)
            seconds = statistics.median(ensemble.run(title, method, setting)[1] for _ in range(ROUNDS))
            return Line(f"ours, {title}, {method}", setting, seconds / count, error, count)
        errors.append(error)
        if len(errors) > 4 and max(errors[-5:]) < 1.01 * min(errors[-5:]):
            return None  # the bars' elasticity is the error, not the steps
    return None


def find_peer(
    ensemble: Ensemble, makers: list[Callable[[], Contender]], settings: Sequence[float], limit: float
) -> Line | None:
    """Return the cheapest setting of a peer that meets the error on the motions it runs."""
    contenders = [make() for make in makers]
    at = ensemble.structure.coordinate_node_axis
    for setting in settings:
        seconds, worst = [], 0.0
        for k, contender in enumerate(contenders):
            measured = measure(contender, setting)
            if measured.run.status != "ok":
                worst = float("inf")
                break
            end = measured.run.node_position[-1][at[:, 0], at[:, 1]]
            worst = max(worst, ensemble.error(end[None], slice(k, k + 1)))
            seconds.append(measured.seconds)
            if worst > limit:
                break
        if worst <= limit:
            return Line(contenders[0].name, setting, statistics.mean(seconds), worst, len(contenders))
    return None


def list_peers(ensemble: Ensemble, count: int) -> Iterator[tuple[str, list[Callable[[], Contender]]]]:
    """Yield each peer's name with what makes it for each of the first motions."""
    problems = [ensemble.problem(k) for k in range(count)]
    for contenders in (mujoco_tendons.contenders, cvode.contenders, sundials.contenders):
        made = [list(contenders(problem)) for problem in problems]
        for row in zip(*made, strict=True):
            yield row[0][0], [make for _, make in row]


def describe_line(name: str, line: Line | None, best: float) -> tuple[str, ...]:
    """Return one row of the table; best: seconds of the fastest of ours with bars taken alike."""
    if line is None:
        return (name, "does not meet the error", "", "", "", "")
    ratio = f"{line.seconds / best:.3g}"
    setting, each = f"{line.setting:.1e}", f"{1e3 * line.seconds:.4f}"
    return (name, setting, each, f"{line.error:.1e}", f"{line.count}", ratio)


def describe_finding(rows: Sequence[Sequence[str]]) -> str:
    """Return the least ratio of the others."""
    others = {row[0]: float(row[5]) for row in rows if row[5] and not row[0].startswith("ours")}
    fastest = min(others, key=lambda name: others[name], default="none")
    return f"{others.get(fastest, np.nan):.3g} times as fast as the fastest other way: {fastest}"


def _silence_mujoco() -> None:
    """Keep MuJoCo from writing to a file that steps are too long; its data say so too."""
    with contextlib.suppress(ImportError):
        import mujoco

        mujoco.set_mju_user_warning(lambda _: None)


def main() -> None:
    """Print the table, and write it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--error", type=float, default=1e-5)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--peers", type=int, default=4)
    parser.add_argument("--ratio", type=float, default=1e3)
    parser.add_argument("--compiler", default=None)
    parser.add_argument("--write", action="store_true", help=f"write into docs/{PAGE}")
    given = parser.parse_args()
    structure = make_structure(given.ratio)
    ensemble = Ensemble(structure, given.count, given.seconds, given.compiler, given.ratio)
    found: dict[str, Line | None] = {}
    for title, method in itertools.product(FORMULATIONS, METHODS):
        settings = OWN_STEPS if method == "rk4" else OWN_TOLERANCES
        found[f"ours, {title}, {method}"] = find_own(ensemble, title, method, settings, given.error)
    known = [line for line in found.values() if line is not None]
    best = {
        is_rigid: min((line.seconds for line in known if ("rigid" in line.name) == is_rigid), default=np.nan)
        for is_rigid in (False, True)
    }
    _silence_mujoco()
    for name, makers in list_peers(ensemble, given.peers):
        settings = PEER_STEPS if name.startswith("MuJoCo") else PEER_TOLERANCES
        with contextlib.suppress(Unavailable):
            found[name] = find_peer(ensemble, makers, settings, given.error)
        print(name, flush=True)
    rows = [describe_line(name, line, best["rigid" in name]) for name, line in found.items()]
    publish(
        PAGE,
        describe_finding(rows),
        f"{given.count:,} motions of {given.seconds:g} s in a batch, errors at most {given.error:g} m, bars "
        f"{given.ratio:g} times as stiff as cables; references differ by {ensemble.apart:.1e} m. Times "
        "over ours "
        "are over the fastest of ours with bars taken alike, elastic or rigid.",
        draw_bars(HEADS[0], HEADS[-1]),
        table_text(HEADS, rows),
        find_about(__doc__),
        write=given.write,
    )


if __name__ == "__main__":
    main()
