"""The constant tables of a controller in C."""

from collections.abc import Sequence

import numpy as np

from tensegrity_codegen.control.embedded.knots import tabulate_gains, tabulate_inputs, tabulate_states
from tensegrity_codegen.control.embedded.parts import ControllerParts
from tensegrity_codegen.control.embedded.table_printer import Table, TablePrinter
from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.structure.bodies import BodyInput
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.tables.precision import Precision


def count_knots(parts: ControllerParts) -> dict[str, int]:
    """Return the numbers of knots by the names that the C files have for them."""
    gains, estimator = parts.gains, parts.estimator
    found = {"N_MOTION": len(parts.motion.time)}
    if gains is not None:
        found["N_GAIN"] = max(len(gains.time), 2)
    if estimator is not None:
        found["N_FILTER"] = max(len(estimator.time), 2)
    return found


def build_tables(parts: ControllerParts, precision: Precision) -> list[Table]:
    """Return all tables but those of the mass matrix."""
    printer = TablePrinter(precision)
    tables = [*_motion(parts, printer), *_actuators(parts, printer)]
    if parts.gains is not None:
        knots = tabulate_gains(parts.gains.time, parts.gains.K, parts.sample)
        tables += printer.knots("GAIN_TIME", "GAIN", knots, "gains: rows of actuators at each knot")
        if parts.n_past:
            count = split_delays(parts.gains.delay, parts.sample)[2]
            starts = np.concatenate([[0], np.cumsum(count)])
            tables.append(printer.whole("PAST_START", starts, "where commands on their way begin, of each"))
        if len(parts.gains.integral_action):
            tables.append(printer.real("SUM_OUTPUT", parts.gains.integral_action, "what is summed of errors"))
    if parts.estimator is not None:
        knots = tabulate_gains(parts.estimator.time, parts.estimator.L, parts.sample)
        stretches = sorted({0.0, *(float(time) for time in parts.delays().offset if time > 0.0)})
        tables.append(printer.real("STRETCH_START", stretches, "times in a sample when commands arrive [s]"))
        tables += printer.knots("FILTER_TIME", "FILTER_GAIN", knots, "gains of the estimator at each knot")
        weight = tabulate_gains(parts.estimator.time, 1.0 / parts.estimator.innovation, parts.sample).row
        text = "1 over the standard deviations of measurements minus their predictions"
        tables.append(printer.real("FILTER_WEIGHT", weight, text))
        if len(parts.disturbed):
            tables.append(printer.whole("DISTURBED", parts.disturbed, "coordinates with a disturbance force"))
    return tables


def _motion(parts: ControllerParts, printer: TablePrinter) -> list[Table]:
    states, inputs = tabulate_states(parts.motion), tabulate_inputs(parts.motion)
    text = "coordinates, velocities, accelerations, and by how much the next coordinates leave a parabola"
    return [
        *printer.knots("MOTION_TIME", "MOTION_STATE", states, text),
        printer.real("MOTION_INPUT", inputs.row, "values and slopes of all inputs at each knot"),
    ]


def _actuators(parts: ControllerParts, printer: TablePrinter) -> list[Table]:
    bounds, delays = parts.bounds, parts.delays()
    first = [members[0] for members in bounds.members]
    inputs: Sequence[ActuatedInput | BodyInput] = parts.subject.inputs
    kept = [(k, item.targets) for k, item in enumerate(inputs) if item.kind == "rest_length"]
    pulls = [[k for k, targets in kept if member in targets] for member in first]
    starts = np.concatenate([[0], np.cumsum([len(row) for row in pulls])])
    return [
        printer.whole("ACTUATOR_PLACE", bounds.place, "input of each actuator"),
        printer.real("ACTUATOR_LEAST", bounds.least, "least input of each [m]"),
        printer.real("ACTUATOR_MOST", bounds.most, "largest input of each [m]"),
        printer.real("ACTUATOR_RATE", bounds.rate, "largest rate of each [m/s]"),
        printer.whole("DELAY_SAMPLES", delays.back, "whole samples of the delay of each"),
        printer.real("DELAY_REST", delays.offset, "rest of the delay of each [s]"),
        printer.real(
            "REST_LENGTH", parts.subject.rest_length[first], "rest length of the first member of each [m]"
        ),
        printer.whole("REST_START", starts, "where the inputs that change it begin"),
        printer.whole("REST_INPUT", [k for row in pulls for k in row], "these inputs"),
    ]
