"""Commands that write the scene of one case of a sweep and run it alone."""

import shlex
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tensegrity_codegen.sweeps.summary.results import SweepResults


CONTROL = "steps"  # what tolerances of batches bound by default; one motion has another default
# Options of an operation that its verb has too.
VERBS = {
    "simulate": ("t_end", "samples", "method", "step", "rtol", "atol", "max_steps", "control"),
    "equilibrium": ("tolerance", "method"),
    "linearize": ("settle",),
}
PROGRAM, INPUT = "tensegrity-codegen", "input."


def build_commands(results: "SweepResults", case: int) -> tuple[str, ...]:
    """Return the commands that write the scene of a case and run it alone."""
    file = f"case{case}.toml"
    write = [PROGRAM, "sweep", "case", str(results.path), str(case), "--out", file]
    keys = {
        key: repr(value) for key, value in zip(results.keys, results.key_values[case].tolist(), strict=True)
    }
    inputs = {key: text for key, text in keys.items() if key.startswith(INPUT)}
    words = [PROGRAM, results.operation, file, *_list_options(results)]
    if results.operation in VERBS:
        for key, text in inputs.items():
            words += ["--input", f"{key.removeprefix(INPUT)}={text}"]
    else:  # no verb: a sweep of one case
        words = [PROGRAM, "sweep", file, "--do", results.operation]
        for key, text in (inputs or dict(list(keys.items())[:1])).items():
            words += ["--over", f"{key}={text}"]
        for text in results.keep:
            words += ["--keep", text]
        words += ["--out", f"case{case}.zarr"]
    return (shlex.join(write), shlex.join(words))


def _list_options(results: "SweepResults") -> list[str]:
    """Return the options of the operation as words of its verb."""
    options = dict(results.options) | {"settle": results.options.get("about") == "equilibrium"}
    words = []
    for name in VERBS.get(results.operation, ()):
        value, option = options.get(name), "--" + name.replace("_", "-")
        if name == "control" and value is None:
            value = CONTROL
        if value is True:
            words.append(option)
        elif value not in (None, False, ""):
            words += [option, repr(value) if isinstance(value, float) else str(value)]
    return words
