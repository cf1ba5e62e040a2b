"""What the steps of a controller in C return."""

from collections.abc import Mapping

# Word: sentence, in the order of the numbers. Simulated loops have the first six and the last one.
CONTROL_STATUS: Mapping[str, str] = {
    "ok": "the command is what feedback asks for, or gives the same forces",
    "rate_limited": "the command was cut to the rate of an actuator",
    "range_limited": "the command was cut to the range of an actuator",
    "tension_limited": "least tensions prevent the forces that feedback asks for",
    "least_tension": "a least tension cannot be reached within rate and range, and yields",
    "not_solved": "tensions were not distributed; the command is that of feedback, cut",
    "non_finite_input": "a time, measurement or state is not finite; the last command holds",
    "invalid_length": "a measured length is not above 0; the last command holds",
    "late": "more than 1.5 samples after the expected time; the last command holds",
    "repeated_time": "not after the time of the last step; the last command holds",
    "estimate_lost": "the estimate was not finite and starts again from the motion; the last command holds",
    "null_pointer": "a pointer that is needed is NULL; the last command holds",
    "not_initialised": "init was not called with this memory; the command is that of the start",
    "outlier": "a measurement is too far from its prediction and is not used; the last command holds",
}
