"""Libraries of other machines, run here under emulators: the same calls on each, and their numbers.

A run prints one number a line for each call, in the order of the manifest: status, then the result.
"""

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS, Compiler
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.tables.manifest import ArgumentSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.targets import TARGETS
from tests.codegen.build_c import run

Numbers = Mapping[str, NDArray[np.float64]]
CASES = 3
SAMPLES = (5e-4, 2e-3)
GLIBC = {"aarch64-linux": ("/usr/aarch64-linux-gnu", "libc6-arm64-cross")}


def result_size(manifest: Manifest, quantity: str) -> int:
    spec = next(item for item in manifest.functions if item.quantity == quantity)
    return len(spec.pattern.row) if spec.pattern is not None else math.prod(spec.shape)


def choose_values(argument: ArgumentSpec, case: int) -> list[float]:
    """Return values near those of the scene, others in each case."""
    shift = 0.01 if argument.name in ("coordinate", "velocity") else 0.0
    return [
        value * (1 + 0.02 * math.sin(1 + k + 7 * case)) + shift * math.cos(2 + k + 5 * case)
        for k, value in enumerate(argument.nominal)
    ]


def list_calls(manifest: Manifest) -> list[tuple[str, int]]:
    """Return the name of each call and how many numbers it prints, status included."""
    calls = [
        (f"{spec.quantity} {case}", 1 + result_size(manifest, spec.quantity))
        for spec in manifest.functions
        for case in range(CASES)
    ]
    size = 2 * len(manifest.coordinate_name) * (1 + len(SAMPLES))
    return calls + [(f"integrate_{spec.name}", 1 + size) for spec in manifest.integrators]


def split(manifest: Manifest, text: str) -> Numbers:
    """Return the numbers of each call from what a run printed."""
    values, start, found = np.array(text.split(), dtype=float), 0, {}
    for name, count in list_calls(manifest):
        found[name] = values[start : start + count]
        start += count
    assert start == len(values)
    return found


def compare(first: Numbers, second: Numbers) -> dict[str, float]:
    """Return the largest difference of each call over its largest value; statuses must be 0 in both."""
    assert first.keys() == second.keys()
    for numbers in (first, second):
        assert {name: values[0] for name, values in numbers.items() if values[0] != 0} == {}
    return {
        name: float(np.max(np.abs(values[1:] - second[name][1:]), initial=0.0))
        / max(float(np.max(np.abs(values[1:]), initial=0.0)), 1e-300)
        for name, values in first.items()
    }


def format_calls(manifest: Manifest) -> str:
    """Return a C program that makes the calls and prints their numbers."""
    real = find_precision(manifest.precision).c_type
    lines = [
        "#include <stdio.h>",
        "#include <string.h>",
        f'#include "{manifest.name}.h"',
        f"typedef {real} real;",
        "static void show(int status, const real *value, int count)\n{",
        '  int k;\n  printf("%d\\n", status);',
        '  for (k = 0; k < count; ++k) { printf("%.17g\\n", (double)value[k]); }\n}',
    ]
    for argument in manifest.arguments:
        for case in range(CASES if argument.nominal else 0):
            text = ", ".join(f"(real){value!r}" for value in choose_values(argument, case))
            lines.append(f"static const real {argument.name}_{case}[] = {{{text}}};")
    lines.append("int main(void)\n{")
    for spec in manifest.functions:
        size = result_size(manifest, spec.quantity)
        for case in range(CASES):
            words = ", ".join([*(f"{name}_{case}" for name in spec.arguments), "out"])
            lines.append(f"  {{ real out[{size}]; show({spec.symbol}({words}), out, {size}); }}")
    lines += [_format_run(manifest, spec) for spec in manifest.integrators]
    return "\n".join([*lines, "  return 0;\n}\n"])


def _format_run(manifest: Manifest, spec: IntegratorSpec) -> str:
    n = len(manifest.coordinate_name)
    passed = [f"{name}_0" for name in spec.arguments]
    if spec.name == "rk4":
        before, after = ["0.0", "1e-4", "0", "20", "state"], ["&done"]
    else:
        before, after = ["2e-3", "1e-9", "1e-11", "1000", "&time", "&step", "state"], ["&done", "&rejected"]
    tensions = []
    if spec.name == "radau":
        tensions, after = ["tensions"], ["count", "vibration"]
    samples = [str(len(SAMPLES)), "times", "state + " + str(2 * n), *tensions, "&sampled"]
    words = ", ".join([*before, *passed, *samples, *after, "work"])
    size = 2 * n * (1 + len(SAMPLES))
    return f"""  {{
    static const double times[] = {{{", ".join(map(repr, SAMPLES))}}};
    static real state[{size}], work[{spec.work_size}];
    static double time, step, vibration[3], tensions[{max(len(SAMPLES) * len(manifest.member_name), 1)}];
    static long long sampled, done, rejected, count[6];
    memcpy(state, {manifest.name}_nominal_coordinate, {n} * sizeof state[0]);
    memcpy(state + {n}, {manifest.name}_nominal_velocity, {n} * sizeof state[0]);
    (void)time; (void)step; (void)vibration; (void)tensions; (void)done; (void)rejected; (void)count;
    show({spec.symbol}({words}), state, {size});
  }}"""


def _program(
    folder: Path, manifest: Manifest, compiler: Compiler, libraries: Sequence[str], *options: str
) -> Path:
    (folder / "calls.c").write_text(format_calls(manifest), encoding="utf-8")
    flags = ("-std=c99", "-O1", "-ffp-contract=off", *options)
    run([*compiler.command, *flags, "calls.c", *libraries, "-lm", "-o", "calls.exe"], folder, compiler)
    return folder / "calls.exe"


def _print(command: Sequence[str], manifest: Manifest, folder: Path, **more: Any) -> Numbers:
    return split(manifest, run(command, folder, **more).stdout)


def in_c(folder: Path, manifest: Manifest) -> Numbers:
    """Run on this machine: the sources beside the manifest, compiled by the first compiler found."""
    sources = sorted(path.name for path in folder.glob(f"{manifest.name}*.c"))
    options = FLAG_SETS["reference"].options
    program = _program(folder, manifest, find_compiler(), sources, *options)
    return _print([str(program)], manifest, folder)


def require(program: str, package: str) -> str:
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed; on Debian and Ubuntu: apt install {package}")
    return found


def in_qemu(folder: Path, manifest: Manifest) -> Numbers:
    """Run the library of a Linux machine, or of a microcontroller, under qemu-user."""
    target, zig = TARGETS[manifest.target], find_compiler("zig")
    if (
        target.is_archive
    ):  # its code runs on the larger processors of the family, which have an operating system
        emulator = [require("qemu-arm", "qemu-user")]
        options = ("-target", "arm-linux-musleabihf", "-mcpu=cortex_a15", "-static")
    else:
        emulator = [require("qemu-aarch64", "qemu-user"), "-L", _find_glibc(manifest.target)]
        options = target.options
    library = f"{target.prefix}{manifest.name}{target.suffix}"
    program = _program(folder, manifest, zig, [f"./{library}"], *options)
    return _print([*emulator, str(program)], manifest, folder, LD_LIBRARY_PATH=str(folder))


def _find_glibc(name: str) -> str:
    place, package = GLIBC[name]
    if not Path(place).is_dir():
        pytest.skip(
            f"there is no C library of {name} in {place}; on Debian and Ubuntu: apt install {package}"
        )
    return place


def in_wine(folder: Path, manifest: Manifest) -> Numbers:
    """Run the library of Windows under wine."""
    wine = require("wine", "wine")
    options = TARGETS[manifest.target].options
    program = _program(folder, manifest, find_compiler("zig"), [f"{manifest.name}.dll"], *options)
    (folder / "prefix").mkdir(exist_ok=True)
    words = {"WINEPREFIX": str(folder / "prefix"), "WINEDEBUG": "-all"}
    return _print([wine, str(program)], manifest, folder, **words)


def in_wasm(folder: Path, manifest: Manifest) -> Numbers:
    """Run the module under wasmtime: functions, and integration with fixed steps where it has one."""
    wasmtime = pytest.importorskip("wasmtime", reason="the package wasmtime is not installed")
    store = wasmtime.Store()
    module = wasmtime.Module.from_file(store.engine, str(folder / f"{manifest.name}.wasm"))
    names = wasmtime.Instance(store, module, []).exports(store)
    names["_initialize"](store)
    return _Wasm(manifest, names, store).run()


class _Wasm:
    """Calls of a WebAssembly module, as docs/machines.md explains them."""

    def __init__(self, manifest: Manifest, names: Any, store: Any) -> None:
        self.manifest, self.names, self.store = manifest, names, store
        self.memory = names["memory"]
        self.dtype = find_precision(manifest.precision).dtype
        self.top = names["__heap_base"].value(store)

    def place(self, values: Any, dtype: Any = None) -> int:
        """Write an array into free memory, which grows as needed; return its address."""
        data = np.ascontiguousarray(values, dtype=dtype or self.dtype).tobytes()
        start = -(-self.top // 16) * 16
        self.top = start + len(data)
        missing = self.top - self.memory.data_len(self.store)
        if missing > 0:
            self.memory.grow(self.store, -(-missing // 2**16))
        self.memory.write(self.store, data, start)
        return start

    def read(self, address: int, count: int) -> NDArray[np.float64]:
        data = self.memory.read(self.store, address, address + count * self.dtype.itemsize)
        return np.frombuffer(data, self.dtype).astype(float)

    def run(self) -> Numbers:
        found = {}
        for spec in self.manifest.functions:
            size, function = result_size(self.manifest, spec.quantity), self.names[spec.symbol]
            for case in range(CASES):
                given = [self.place(choose_values(self.manifest.argument(n), case)) for n in spec.arguments]
                out = self.place(np.zeros(size))
                status = function(self.store, *given, out)
                found[f"{spec.quantity} {case}"] = np.concatenate([[status], self.read(out, size)])
        for spec in self.manifest.integrators:
            found[f"integrate_{spec.name}"] = self.integrate(spec)
        return found

    def integrate(self, spec: IntegratorSpec) -> NDArray[np.float64]:
        manifest, n = self.manifest, 2 * len(self.manifest.coordinate_name)
        nominal = [*manifest.argument("coordinate").nominal, *manifest.argument("velocity").nominal]
        state = self.place(np.concatenate([nominal, np.zeros(n * len(SAMPLES))]))
        passed = [self.place(choose_values(manifest.argument(name), 0)) for name in spec.arguments]
        scalar: Callable[[], int] = lambda: self.place([0.0], np.float64)  # noqa: E731
        many = max(len(SAMPLES) * len(manifest.member_name), 1)
        if spec.name == "rk4":
            before, after = [0.0, 1e-4, 0, 20, state], [scalar()]
        else:
            before, after = [2e-3, 1e-9, 1e-11, 1000, scalar(), scalar(), state], [scalar(), scalar()]
        tensions = [self.place(np.zeros(many))] if spec.name == "radau" else []
        if spec.name == "radau":
            after = [self.place(np.zeros(6), np.float64), self.place(np.zeros(3), np.float64)]
        first = state + n * self.dtype.itemsize
        times = [len(SAMPLES), self.place(SAMPLES, np.float64), first, *tensions, scalar()]
        work = self.place(np.zeros(spec.work_size))
        status = self.names[spec.symbol](self.store, *before, *passed, *times, *after, work)
        return np.concatenate([[status], self.read(state, n * (1 + len(SAMPLES)))])
