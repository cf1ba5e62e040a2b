"""SCS Figs 4 to 11 and equations (44), (45), (52), (53), computed: plain dicts and arrays.

A row of a comparison has equation, quantity, unit, paper, ours, difference = ours - paper.
"""

import math
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.studies.papers.scs.printed import (
    PAPER_DURATION,
    PAPER_POSES,
    PRINTED_SIDE,
    PaperPose,
    PrintedTower,
    compile_tower,
    drive_as_printed,
    track,
)
from tensegrity_codegen.studies.papers.scs.reconfiguration import Reconfiguration, plan_reconfiguration
from tensegrity_codegen.studies.papers.scs.symmetry import GROUPS, SymmetricPose, SymmetricTower
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import InvalidValueError, StructureError

# Where a tower can stand symmetrically: maps over azimuth and declination, prestressable configurations.
#
# Under a force F_3 the tensions are A_r^-1 (0, 0, F_3) (SCS 31), so only the sign of F_3 matters for the map.
# Without a force they are a null vector of A_r, which exists only on the contour det(A_r) = 0 (SCS 42).


OUTSIDE = -1
MAX_CELLS = 1_000_000


@dataclass(frozen=True)
class RegionMap:
    """The feasible regions over a grid of alpha (columns) and delta (rows) at one height and force.

    alpha_deg (n_a,), delta_deg (n_d,); code (n_d, n_a): 0 all tendons taut, else the sum of 1, 2, 4 for
    saddle, vertical, diagonal that would have to push, -1 outside the bounds; tension (n_d, n_a, 3) [N],
    NaN outside; determinant (n_d, n_a): det(A_r), of which the zero contour is SCS (42), NaN outside.
    """

    alpha_deg: FloatArray
    delta_deg: FloatArray
    height: float
    force: float
    code: NDArray[np.int8]
    tension: FloatArray
    determinant: FloatArray

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """(n_d, n_a): where the tower can stand with all tendons taut."""
        return np.asarray(self.code == 0)


@dataclass(frozen=True)
class PrestressablePose:
    """A configuration that stands without load: pose, and tensions per unit of their norm, all positive."""

    pose: SymmetricPose
    tension: FloatArray


def map_regions(
    tower: SymmetricTower,
    height: float,
    force: float,
    *,
    alpha_deg: FloatArray | None = None,
    delta_deg: FloatArray | None = None,
) -> RegionMap:
    """Return the map at a height [m] under F_3 = `force` [N], not zero; by default in steps of 1 degree."""
    alpha = np.arange(0.0, 361.0) if alpha_deg is None else np.asarray(alpha_deg, dtype=np.float64)
    delta = np.arange(1.0, 90.0) if delta_deg is None else np.asarray(delta_deg, dtype=np.float64)
    _check_map(height, force, alpha, delta)
    grid = np.array([(math.radians(a), math.radians(d), height) for d in delta for a in alpha])
    matrix, shape = tower.matrix(grid), (len(delta), len(alpha))
    inside = tower.is_inside(grid).reshape(shape)
    determinant = np.where(inside, np.linalg.det(matrix).reshape(shape), np.nan)
    # T = A_r^-1 (0, 0, F): by cross products, so that nothing is solved where the matrix is singular.
    along = np.cross(matrix[:, 0], matrix[:, 1]).reshape(*shape, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        tension = force * along / determinant[..., None]
    code = (np.where(tension > 0, 0, 1) * np.array([1, 2, 4])).sum(axis=2)
    code[~inside] = OUTSIDE
    return RegionMap(alpha, delta, height, force, code.astype(np.int8), tension, determinant)


def find_prestressable(tower: SymmetricTower, delta: float, height: float) -> tuple[PrestressablePose, ...]:
    """Return the poses of a declination [rad] and height [m] that stand without load (SCS 30, F_3 = 0).

    The azimuths are roots of det(A_r), looked for in steps of 1 degree; those are kept whose null vector has
    one sign.
    """
    tower.check_pose(SymmetricPose(0.0, delta, height), "prestressable configuration")
    azimuth = np.radians(np.arange(0.5, 361.5))

    def determinant(alpha: float) -> float:
        return float(tower.determinant(np.array([[alpha, delta, height]]))[0])

    values = tower.determinant(np.array([(alpha, delta, height) for alpha in azimuth]))
    records = []
    for row in np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1])):
        alpha = float(brentq(determinant, azimuth[row], azimuth[row + 1], xtol=1e-15))
        null = np.linalg.svd(tower.matrix(np.array([[alpha, delta, height]]))[0])[2][-1]
        tension = null * np.sign(null.sum())
        if (tension > 0).all():
            records.append(PrestressablePose(SymmetricPose(alpha % (2 * math.pi), delta, height), tension))
    return tuple(records)


def _check_map(height: float, force: float, alpha: FloatArray, delta: FloatArray) -> None:
    check_positive(height, "height", "[m]")
    if not math.isfinite(force) or force == 0.0:
        raise InvalidValueError(
            "a map needs a force",
            where="force",
            given=force,
            allowed="a finite number that is not zero [N]",
            hint="without a force, see find_prestressable",
        )
    cells = alpha.size * delta.size
    finite = np.isfinite(alpha).all() and np.isfinite(delta).all()
    if not finite or not 1 <= cells <= MAX_CELLS or alpha.ndim != 1 or delta.ndim != 1:
        raise InvalidValueError(
            "not a grid",
            where="alpha_deg, delta_deg",
            given=f"{alpha.shape} x {delta.shape}",
            allowed=f"two lists of finite angles, at most {MAX_CELLS} cells",
        )


SYMBOLS = ("T_S", "T_V", "T_D")


def load_paper_tower() -> SymmetricTower:
    """Return the shipped tower of the paper's data."""
    with as_file(files("tensegrity_codegen.scene").joinpath("examples", "svd_tower.toml")) as path:
        system, _ = load_scene(path)
    if not isinstance(system, BodySystem):
        raise StructureError("not a scene of bodies", where=system.name)
    return SymmetricTower(system)


def plan_paper_motions(tower: SymmetricTower) -> dict[str, Reconfiguration]:
    """Return the paper's motions.

    "with_torque": (44) to (45), Figs 4 to 7; "zero_torque": from (52) to 65 deg, Figs 8 to 10; "prescribed":
    the same ends with both angles by the quintic, Fig. 11.
    """
    first, second, third, fourth = (PAPER_POSES[key] for key in ("44", "45", "52", "53"))
    with_torque = plan_reconfiguration(
        tower, first.pose, second.pose, duration=PAPER_DURATION, force=first.force
    )
    zero_torque = plan_reconfiguration(
        tower, third.pose, fourth.pose, duration=PAPER_DURATION, force=third.force, zero_torque=True
    )
    prescribed = plan_reconfiguration(
        tower, third.pose, zero_torque.end, duration=PAPER_DURATION, force=third.force
    )
    return {"with_torque": with_torque, "zero_torque": zero_torque, "prescribed": prescribed}


def compare_equilibria(tower: SymmetricTower) -> list[dict[str, Any]]:
    """Return the printed tensions and the printed end of (53) beside ours.

    with_printed_data: the same quantity from the printed b and Z, which are rounded.
    """
    motions = plan_paper_motions(tower)
    poses = {key: printed.pose for key, printed in PAPER_POSES.items()} | {"53": motions["zero_torque"].end}
    rows: list[dict[str, Any]] = []
    for key, printed in PAPER_POSES.items():
        ours, rounded = tower.equilibrium(poses[key], printed.force), _with_printed_data(tower, printed)
        for k, symbol in enumerate(SYMBOLS):
            row = _compare(printed.equation, symbol, "N", printed.tension[k], float(ours[k]))
            rows.append(row | {"with_printed_data": float(rounded[k])})
    end = motions["zero_torque"].end.in_degrees[1]
    return [*rows, _compare("(48), (53)", "delta_f", "deg", PAPER_POSES["53"].delta_deg, end)]


def compute_figures(tower: SymmetricTower, n_t: int = 201) -> dict[str, dict[str, Any]]:
    """Return the curves of Figs 4 to 11: figure -> title, time (n_t,) [s], unit, curves name -> (n_t,).

    The paper prints these as pictures without numbers; their ends are in compare_equilibria.
    """
    records = {name: plan.sample(n_t) for name, plan in plan_paper_motions(tower).items()}
    figures: dict[str, dict[str, Any]] = {}
    for number, name in ((4, "with_torque"), (8, "zero_torque")):
        record = records[name]
        time = record.time
        angles = {"alpha": record.alpha_deg, "delta": record.delta_deg}
        figures[f"Fig. {number}"] = _figure("angles", "deg", time, angles)
        lengths = dict(zip(("S_0", "V_0", "D_0"), record.rest_length.T, strict=True))
        figures[f"Fig. {number + 1}"] = _figure("rest lengths", "m", time, lengths)
        tension = dict(zip(SYMBOLS, record.tension.T, strict=True))
        figures[f"Fig. {number + 2}"] = _figure("tensions", "N", time, tension)
    for number, name in ((7, "with_torque"), (11, "prescribed")):
        record = records[name]
        figures[f"Fig. {number}"] = _figure("torque", "N m", record.time, {"M_3": record.torque})
    return dict(sorted(figures.items(), key=lambda figure: int(figure[0].split()[1])))


def compute_paper_maps(
    tower: SymmetricTower, step_deg: float = 1.0, span_deg: float = 120.0
) -> dict[str, RegionMap]:
    """Return the maps of feasible configurations at the paper's two heights and forces, from azimuth 0."""
    alpha, delta = np.arange(0.0, span_deg, step_deg), np.arange(step_deg, 90.0, step_deg)
    return {
        printed.equation: map_regions(tower, printed.height, printed.force, alpha_deg=alpha, delta_deg=delta)
        for printed in (PAPER_POSES["44"], PAPER_POSES["52"])
    }


def compare_tracking(
    tower: SymmetricTower, *, rtol: float = 1e-10, samples: int = 101
) -> list[dict[str, Any]]:
    """Return how the full model in C follows each motion, by our controls and by (34) as printed."""
    model, rows = compile_tower(tower), []
    for name, plan in plan_paper_motions(tower).items():
        for controls, schedule in (("ours", None), ("as printed", drive_as_printed(plan))):
            followed = track(
                plan, schedule=schedule, model=model, rtol=rtol, atol=0.1 * rtol, samples=samples
            )
            rows.append({"motion": name, "controls": controls, **followed.summary()})
    return rows


def _figure(title: str, unit: str, time: FloatArray, curves: dict[str, FloatArray]) -> dict[str, Any]:
    return {"title": title, "unit": unit, "time": time, "curves": curves}


def _compare(equation: str, quantity: str, unit: str, paper: float, ours: float) -> dict[str, Any]:
    return {
        "equation": equation,
        "quantity": quantity,
        "unit": unit,
        "paper": paper,
        "ours": ours,
        "difference": ours - paper,
    }


def _with_printed_data(tower: SymmetricTower, printed: PaperPose) -> FloatArray:
    """Return the tensions at the printed, rounded b and Z, by the closed forms."""
    rounded = replace(PrintedTower.of(tower), side=PRINTED_SIDE)
    rest_length = np.zeros(len(GROUPS))
    return rounded.tension(printed.printed_pose.parameter, rest_length, rest_length, printed.force)


# Each formula of SCS that is wrong in print, measured against the full model of 18 coordinates.
#
# The difference of the printed and of the corrected formula from the equations obtained from the full model,
# largest over random symmetrical motions: the first is of the size of the terms, the second is rounding.


def check_errata(tower: SymmetricTower, *, samples: int = 50, seed: int = 1) -> list[dict[str, Any]]:
    """Return one row an erratum: name, equation, unit, error_as_printed, error_as_corrected."""
    generator = np.random.default_rng(seed)
    motions = [_draw(generator) for _ in range(samples)]
    checks = (
        ("centrifugal term", "(23), (34)", "N m", _centrifugal),
        ("sin(delta) in the second row of A_r", "(A.4) to (A.6)", "m", _matrix),
        ("height", "(21), (28)", "N m", _height),
    )
    rows = []
    for name, equation, unit, check in checks:
        errors = np.abs([check(tower, *motion) for motion in motions]).max(axis=0)
        rows.append(_row(name, equation, unit, errors[0], errors[1]))
    return [*rows, _rounded_data(tower)]


def _draw(generator: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return s, s', s'' with s inside the bounds of SCS 4, and Z' and Z'' too."""
    s = np.array([generator.uniform(0, 6.28), generator.uniform(0.1, 1.4), generator.uniform(1.1, 2.0)])
    return s, generator.normal(size=3), generator.normal(size=3)


def _centrifugal(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return the first entry of e, printed and corrected, less that of the full model, at constant Z."""
    rate, change = rate * (1, 1, 0), change * (1, 1, 0)
    reduced = tower.restricted.balance(s, rate, change).reduced()
    printed = PrintedTower.of(tower)
    entries = [printed.own_force(s, rate, change, 0.0, as_printed=flag)[0] for flag in (True, False)]
    return np.asarray(np.array(entries) - reduced.own_force[1] / 6.0)


def _matrix(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return the largest difference of A_r from that of the full model, printed and corrected."""
    matrix, printed, numbers = tower.matrix(s[None])[0], PrintedTower.of(tower), [float(x) for x in s]
    differences = [printed.matrix(*numbers, as_printed=flag) - matrix for flag in (True, False)]
    return np.array([np.abs(difference).max() for difference in differences])


def _height(tower: SymmetricTower, s: FloatArray, rate: FloatArray, change: FloatArray) -> FloatArray:
    """Return d/dt(Z' sin(delta)) and Z'' sin(delta), times m l / 2, less what the full model leaves over."""
    own_force = tower.restricted.balance(s, rate, change).own_force
    names = tower.system.coordinate_name
    lower, upper = (own_force[names.index(f"bar{stage}_declination")] for stage in ("11", "12"))
    arm, sine = 0.5 * tower.bar.mass * tower.bar.length, math.sin(s[1])
    corrected = arm * sine * change[2]
    printed = corrected + arm * math.cos(s[1]) * rate[1] * rate[2]
    return np.asarray(np.array([printed, corrected]) - (upper - lower))


def _rounded_data(tower: SymmetricTower) -> dict[str, Any]:
    """Return the largest error of the tensions in (44), (45), (52) with printed and with exact data."""
    rows = [row for row in compare_equilibria(tower) if row["unit"] == "N"]
    rows = [row for row in rows if row["equation"] != PAPER_POSES["53"].equation]
    rounded = max(abs(row["with_printed_data"] - row["paper"]) for row in rows)
    return _row(
        "rounded b and Z", "(43) to (45), (52)", "N", rounded, max(abs(r["difference"]) for r in rows)
    )


def _row(name: str, equation: str, unit: str, printed: float, corrected: float) -> dict[str, Any]:
    return {
        "name": name,
        "equation": equation,
        "unit": unit,
        "error_as_printed": float(printed),
        "error_as_corrected": float(corrected),
    }
