"""The constant tables of a controller in C: motion, gains, estimator, actuators, distribution of tensions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.codegen.print.printer import print_numbers
from tensegrity_codegen.control.embedded.parts import ControllerParts, limit_iterations
from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.control.feedback.loop.tension_distribution import PASSES, TensionDistribution
from tensegrity_codegen.control.feedback.policy import Policy
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.bodies import BodyInput
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.manifest import FunctionSpec
from tensegrity_codegen.tables.precision import Precision

UNLIMITED = {"double": 1e300, "single": 1e30}  # in place of infinite bounds
INT = "int"
# With smaller weights rounding in single precision hides which bounds depend on each other.
MIN_WEIGHT = {"double": 0.0, "single": 1e-4}


@dataclass(frozen=True)
class Knots:
    """Rows of numbers at rising times, two rows at least."""

    time: FloatArray  # (n_knots,) [s]
    row: FloatArray  # (n_knots, n): numbers at each time


def tabulate_states(motion: Motion) -> Knots:
    """Return coordinates, velocities and accelerations of a motion, and the steps of its polynomials.

    Returns: rows (q, v, a, g): g = q_next - q - h v - h^2 a / 2, by which the coordinates at the next knot
        differ from a parabola. Stored, it keeps digits which the difference of coordinates would lose in C.
    """
    q, v, a = (
        np.asarray(x, dtype=np.longdouble) for x in (motion.coordinate, motion.velocity, motion.acceleration)
    )
    h = np.diff(np.asarray(motion.time, dtype=np.longdouble))[:, None]
    gap = np.zeros_like(q)
    gap[:-1] = np.diff(q, axis=0) - h * v[:-1] - h**2 * a[:-1] / 2
    return Knots(motion.time, np.hstack([q, v, a, gap]).astype(np.float64))


def tabulate_inputs(motion: Motion) -> Knots:
    """Return the inputs of a motion and their slopes, rows (u, u'), of the spline of `Motion.profile`."""
    pieces = motion.profile().pieces
    value, slope = pieces.coefficient[:, 0], pieces.coefficient[:, 1]
    h = pieces.time[-1] - pieces.time[-2]
    powers = np.arange(1, pieces.coefficient.shape[1])
    end_slope = (powers * h ** (powers - 1)) @ pieces.coefficient[-1, 1:]
    ends = np.vstack([value, motion.input[-1]]), np.vstack([slope, end_slope])
    return Knots(pieces.time, np.hstack(ends))


def tabulate_gains(time: FloatArray, gains: FloatArray, sample: float) -> Knots:
    """Return gains (n_knots, rows, columns) at their times; a single one holds at all times."""
    rows = gains.reshape(len(gains), -1)
    if len(rows) == 1:
        return Knots(np.array([time[0], time[0] + sample]), np.vstack([rows, rows]))
    return Knots(np.asarray(time), rows)


# Arrays as constant tables in C.


@dataclass(frozen=True)
class Table:
    """A constant array: name, C type, entries as C text, comment; an empty one has a zero in its place."""

    name: str
    c_type: str
    values: list[str]
    comment: str


@dataclass(frozen=True)
class TablePrinter:
    """Prints arrays as C text."""

    precision: Precision

    def real(self, name: str, values: ArrayLike, comment: str) -> Table:
        """Return a table of numbers, row by row; infinite ones become very large."""
        limit = UNLIMITED[self.precision.name]
        numbers = np.clip(np.asarray(values, dtype=np.float64).ravel(), -limit, limit)
        texts = print_numbers(numbers, self.precision, name)
        return Table(name, self.precision.c_type, texts or ["0"], comment)

    def whole(self, name: str, values: ArrayLike, comment: str, c_type: str = INT) -> Table:
        """Return a table of whole numbers."""
        numbers = np.asarray(values, dtype=np.int64).ravel().tolist()
        return Table(name, c_type, list(map(str, numbers)) or ["0"], comment)

    def knots(self, time: str, rows: str, knots: Knots, comment: str) -> list[Table]:
        """Return the tables of the times of knots and of their rows."""
        return [self.real(time, knots.time, "times of the knots [s]"), self.real(rows, knots.row, comment)]


def count_knots(parts: ControllerParts) -> dict[str, int]:
    """Return the numbers of knots by the names that the C files have for them."""
    gains, estimator = parts.gains, parts.estimator
    if parts.policy is not None:
        return {}
    counts = {"N_MOTION": len(parts.motion.time)}
    if gains is not None:
        counts["N_GAIN"] = max(len(gains.time), 2)
    if estimator is not None:
        counts["N_FILTER"] = max(len(estimator.time), 2)
    return counts


def build_tables(parts: ControllerParts, precision: Precision) -> list[Table]:
    """Return all tables but those of the mass matrix."""
    printer = TablePrinter(precision)
    if parts.policy is not None:
        return [
            *_tabulate_policy(parts.policy, parts.motion.input[0], printer),
            *_tabulate_actuators(parts, printer),
        ]
    states, inputs = tabulate_states(parts.motion), tabulate_inputs(parts.motion)
    comment = "coordinates, velocities, accelerations, and by how much the next coordinates leave a parabola"
    tables = printer.knots("MOTION_TIME", "MOTION_STATE", states, comment)
    tables.append(printer.real("MOTION_INPUT", inputs.row, "values and slopes of all inputs at each knot"))
    tables += _tabulate_actuators(parts, printer)
    if parts.gains is not None:
        knots = tabulate_gains(parts.gains.time, parts.gains.K, parts.sample)
        tables += printer.knots("GAIN_TIME", "GAIN", knots, "gains: rows of actuators at each knot")
        if parts.n_past:
            count = split_delays(parts.gains.delay, parts.sample)[2]
            starts = np.concatenate([[0], np.cumsum(count)])
            tables.append(printer.whole("PAST_START", starts, "where commands on their way begin, of each"))
    if len(parts.integral_action):
        tables.append(printer.real("SUM_OUTPUT", parts.integral_action, "what is summed of errors"))
    if parts.estimator is not None:
        knots = tabulate_gains(parts.estimator.time, parts.estimator.L, parts.sample)
        stretches = sorted({0.0, *(float(time) for time in parts.delays().offset if time > 0.0)})
        tables.append(printer.real("STRETCH_START", stretches, "times in a sample when commands arrive [s]"))
        tables += printer.knots("FILTER_TIME", "FILTER_GAIN", knots, "gains of the estimator at each knot")
        weight = tabulate_gains(parts.estimator.time, 1.0 / parts.estimator.innovation, parts.sample).row
        comment = "1 over the standard deviations of measurements minus their predictions"
        tables.append(printer.real("FILTER_WEIGHT", weight, comment))
        if len(parts.disturbed):
            tables.append(printer.whole("DISTURBED", parts.disturbed, "coordinates with a disturbance force"))
    return tables


def _tabulate_policy(policy: Policy, start: FloatArray, printer: TablePrinter) -> list[Table]:
    actions = policy.description.action
    weights = np.concatenate([weight.ravel() for weight in policy.weights])
    return [
        printer.whole("POLICY_SIZE", policy.sizes, "sizes of the observation and of all layers"),
        printer.whole(
            "POLICY_SOURCE", policy.description.sources, "where observed numbers are, -1 - k: command k"
        ),
        printer.real("POLICY_MEAN", policy.mean, "what is subtracted from each"),
        printer.real("POLICY_SCALE", policy.scale, "by what each is divided"),
        printer.real("POLICY_CLIP", [policy.clip], "bound of the result"),
        printer.real("POLICY_WEIGHT", weights, "weights of the layers, row by row"),
        printer.real("POLICY_BIAS", np.concatenate(policy.biases), "biases of the layers"),
        printer.real("START_INPUT", start, "inputs at the start"),
        printer.real("ACTION_CENTRE", [acted.centre for acted in actions], "middle of the range of each [m]"),
        printer.real("ACTION_HALF_RANGE", [acted.half_range for acted in actions], "half of its width [m]"),
    ]


def _tabulate_actuators(parts: ControllerParts, printer: TablePrinter) -> list[Table]:
    bounds, delays = parts.bounds, parts.delays()
    leading = [members[0] for members in bounds.members]
    inputs: Sequence[ActuatedInput | BodyInput] = parts.subject.inputs
    gains = [(k, scene_input.rest_length_gain) for k, scene_input in enumerate(inputs)]
    pulls = [[k for k, targets in gains if member in targets] for member in leading]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in pulls])])
    return [
        printer.whole("ACTUATOR_PLACE", bounds.place, "input of each actuator"),
        printer.real("ACTUATOR_LEAST", bounds.least, "least input of each [m]"),
        printer.real("ACTUATOR_MOST", bounds.most, "largest input of each [m]"),
        printer.real("ACTUATOR_RATE", bounds.rate, "largest rate of each [m/s]"),
        printer.whole("DELAY_SAMPLES", delays.back, "whole samples of the delay of each"),
        printer.real("DELAY_REST", delays.offset, "rest of the delay of each [s]"),
        printer.real(
            "REST_LENGTH", parts.subject.rest_length[leading], "rest length of the first member of each [m]"
        ),
        printer.whole("REST_START", starts, "where the inputs that change it begin"),
        printer.whole("REST_INPUT", [k for row in pulls for k in row], "these inputs"),
    ]


# C text of the numbers of a quadratic program: sizes, members, pulls, bounds.


@dataclass(frozen=True)
class ProgramTables:
    """Sizes and tables of the quadratic program of a distribution, or of model-predictive control."""

    sizes: dict[str, int]  # sizes that the header states, by their names in C
    constants: dict[str, int]  # enumerators of the source alone
    tables: list[Table]  # constant arrays
    has_others: bool = (
        False  # whether inputs that are not the actuators' change rest lengths of driven members
    )


def build_distribution_tables(
    distribution: TensionDistribution,
    motion: Motion,
    matrix: FunctionSpec,
    precision: Precision,
    *,
    iterations: int | None = None,
) -> ProgramTables:
    """Return the numbers of a distribution as the C of a controller needs them."""
    # Driven members, by which actuators, with which limits and preferred tensions.
    cables, driven = distribution.cables, distribution.cables.driven
    pulls, others = cables.incidence[driven] != 0.0, cables.other_incidence[driven] != 0.0
    is_stiff = cables.spring_constant[driven] + cables.axial_stiffness[driven] > 0.0
    limited = np.isin(driven, cables.limited) & is_stiff
    places = find_places(matrix, driven)
    preferred = distribution.preferred
    table = (motion.member_tension if preferred is None else preferred[None])[:, driven]
    printer, weight = TablePrinter(precision), max(distribution.weight, MIN_WEIGHT[precision.name])
    tables = [
        printer.whole("DRIVEN_MEMBER", driven, "members that actuators pull"),
        printer.whole("IS_LIMITED", limited, "whether they have a least tension"),
        printer.real("SPRING_CONSTANT", cables.spring_constant[driven], "their spring constants [N/m]"),
        printer.real("AXIAL_STIFFNESS", cables.axial_stiffness[driven], "their axial stiffnesses [N]"),
        printer.real("DRIVEN_REST", cables.base[driven], "their rest lengths without inputs [m]"),
        printer.real(
            "LEAST_TENSION", np.where(limited, distribution.least_tension[driven], 0.0), "least tensions [N]"
        ),
        printer.real("PREFERRED_TENSION", table, "preferred tensions at each knot [N]"),
        printer.real("WEIGHT_ROOT", [np.sqrt(weight)], "root of the weight of preferred tensions"),
        *tabulate_lists(printer, "PULL_START", "PULL_DRIVEN", pulls.T, "driven members of each actuator"),
        *tabulate_lists(
            printer, "DRIVEN_START", "DRIVEN_PULL", pulls, "actuators that pull each driven member"
        ),
        printer.whole("EQUILIBRIUM_PLACE", places, "place of each entry in the columns of driven members"),
    ]
    if others.any():
        tables += tabulate_lists(
            printer, "OTHER_START", "OTHER_INPUT", others, "other inputs of each driven member"
        )
    sizes = _list_sizes(pulls, limited, motion.coordinate.shape[1], len(cables.base), len(places))
    constants = {
        "N_PREFERRED": len(table),
        "IS_COUPLED": int((pulls.sum(axis=1) > 1).any()),
        "IS_FIXED": int(cables.is_one_to_one),
        "QP_ITERATIONS": limit_iterations(iterations, sizes["N_BOUNDS"]),
        "QP_PASSES": 1 if cables.is_one_to_one else PASSES,
    }
    return ProgramTables(sizes, constants, tables, bool(others.any()))


def _list_sizes(
    pulls: NDArray[np.bool_], limited: NDArray[np.bool_], n_coordinates: int, n_members: int, n_entries: int
) -> dict[str, int]:
    """Return the sizes for members (rows) that actuators (columns) pull."""
    n_driven, n = pulls.shape
    is_shared = pulls.sum(axis=1) > 1
    shared = int((limited & is_shared).sum())
    rows = n_coordinates + (n_driven if is_shared.any() else 0)
    return {
        "N_MEMBERS": n_members,
        "N_DRIVEN": n_driven,
        "N_PULLS": int(pulls.sum()),
        "N_SHARED": shared,
        "N_ROWS": rows,
        "N_TARGETS": rows + n,
        "N_BOUNDS": n + shared,
        "N_SUMMED": max(shared, 1),
        "N_SET": n + 1,
        "SIZE_EQUILIBRIUM": n_entries,
        "SIZE_MATRIX": (rows + n) * n,
        "SIZE_TRIANGLE": n * (n + 1) // 2,
        "SIZE_FACTOR": (n + 1) * (n + 2) // 2,
    }


def list_entries(matrix: FunctionSpec) -> tuple[IntArray, IntArray]:
    """Return row and column of each entry that a model computes of a matrix, sparse or dense."""
    if matrix.pattern is None:
        rows, columns = np.indices(matrix.shape)
        return rows.ravel(), columns.ravel()
    columns = np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.pattern.column_start))
    return matrix.pattern.row.astype(np.int64), columns


def find_places(matrix: FunctionSpec, chosen: IntArray, first_row: int = 0) -> IntArray:
    """Return where each entry of a matrix belongs in its chosen columns, stored row by row; -1: nowhere."""
    rows, columns = list_entries(matrix)
    column_of = np.full(matrix.shape[1], -1)
    column_of[chosen] = np.arange(len(chosen))
    is_stored = (rows >= first_row) & (column_of[columns] >= 0)
    index: IntArray = np.where(is_stored, (rows - first_row) * len(chosen) + column_of[columns], -1)
    return index


def tabulate_lists(
    printer: TablePrinter, start: str, entry: str, chosen: NDArray[np.bool_], comment: str
) -> list[Table]:
    """Return two tables: where the list of each row starts, and the chosen columns of all rows."""
    starts: ArrayLike = np.concatenate([[0], np.cumsum(chosen.sum(axis=1))])
    return [
        printer.whole(start, starts, f"where the {comment} begin"),
        printer.whole(entry, np.nonzero(chosen)[1], comment),
    ]
