"""Tools of the comparison: compiled libraries and their sections, candidates and their timing in turns."""

import ctypes
import hashlib
import json
import os
import struct
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.machine import all_cores
from tensegrity_codegen.codegen.compilation.child import run_limited
from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import Compiler, FlagSet
from tensegrity_codegen.codegen.compilation.toolchain import find_compilers
from tensegrity_codegen.studies.work_precision.measure import Unavailable as Unavailable
from tensegrity_codegen.system.errors import CompileError

_CODE, _TABLES = (".text",), (".rodata", ".data.rel.ro")


def read_sections(path: Path) -> tuple[int, int] | None:
    """Return bytes of code and of constant tables, None if the file is no 64-bit little-endian ELF."""
    data = path.read_bytes()
    if data[:6] != b"\x7fELF\x02\x01":
        return None
    table = struct.unpack_from("<Q", data, 0x28)[0]
    entry, count, names_at = struct.unpack_from("<HHH", data, 0x3A)
    headers = [struct.unpack_from("<IIQQQQ", data, table + k * entry) for k in range(count)]
    names = headers[names_at][4]
    sizes = {"code": 0, "tables": 0}
    for name, _, _, _, _, size in headers:
        text = data[names + name : data.index(b"\0", names + name)].decode("ascii")
        if text.startswith(_CODE):
            sizes["code"] += size
        elif text.startswith(_TABLES):
            sizes["tables"] += size
    return sizes["code"], sizes["tables"]


TIME_LIMIT = 180.0  # s
RECORD = 2  # version of what is kept beside a library


class CompileFailed(Exception):
    """The compiler failed or met its limit; the text says which."""


@dataclass(frozen=True)
class Built:
    """A compiled library: where it is, seconds and peak memory [byte] of the compiler, bytes in it."""

    path: str
    seconds: float
    peak_memory: int | None
    code_bytes: int | None
    table_bytes: int | None


@dataclass(frozen=True)
class Compilation:
    """A folder of libraries by the hash of their texts and commands; time_limit: of one compilation [s]."""

    folder: Path
    time_limit: float = TIME_LIMIT

    def build(self, sources: Mapping[str, str], command: Sequence[str], *, version: str) -> Built:
        """Return what `command` makes of `sources` (file name -> text), from the folder if it is there.

        command: calls a compiler and names the sources; "-o", the output's path are added, then -lm. version:
        of the compiler. Raises CompileFailed.
        """
        return self._keep((sources, command, version), lambda library: self._run(sources, command, library))

    def build_own(self, sources: Mapping[str, str], name: str, compiler: Compiler, flags: FlagSet) -> Built:
        """Return what the package makes of its own sources, as `build` does."""

        def make(library: Path) -> tuple[float, int | None]:
            try:
                made = compile_library(
                    sources, name=name, compiler=compiler, flags=flags, timeout=self.time_limit
                )
            except CompileError as error:
                raise CompileFailed(str(error).splitlines()[0]) from None
            library.write_bytes(made.library)
            return made.seconds, made.peak_memory

        command = (*compiler.command, *flags.options)
        return self._keep((sources, command, compiler.version), make)

    def _keep(
        self,
        parts: tuple[Mapping[str, str], Sequence[str], str],
        make: Callable[[Path], tuple[float, int | None]],
    ) -> Built:
        """Return the kept library of these sources, command and version, made first where there is none."""
        sources, command, version = parts
        text = json.dumps([RECORD, sorted(sources.items()), list(command), version])
        key = hashlib.sha256(text.encode("utf-8")).hexdigest()[:24]
        record, library = self.folder / f"{key}.json", self.folder / f"{key}.so"
        if record.exists():
            known = json.loads(record.read_text(encoding="utf-8"))
            if "failed" not in known:
                return Built(path=str(library), **known)
            if known["limit"] >= self.time_limit:
                raise CompileFailed(known["failed"])
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            with all_cores():
                seconds, peak = make(library)
        except CompileFailed as error:
            record.write_text(json.dumps({"failed": str(error), "limit": self.time_limit}), encoding="utf-8")
            raise
        code, tables = read_sections(library) or (None, None)
        facts = {"seconds": seconds, "peak_memory": peak, "code_bytes": code, "table_bytes": tables}
        record.write_text(json.dumps(facts), encoding="utf-8")
        return Built(path=str(library), **facts)

    def _run(
        self, sources: Mapping[str, str], command: Sequence[str], library: Path
    ) -> tuple[float, int | None]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for file_name, text in sources.items():
                (folder / file_name).write_text(text, encoding="utf-8")
            whole = [*command, "-o", str(library.resolve()), "-lm"]
            outcome = run_limited(whole, folder=folder, environment=os.environ, timeout=self.time_limit)
        if outcome.ended == "time":
            raise CompileFailed(f"does not compile in {self.time_limit:.0f} s")
        if not outcome.ok:
            line = next((line for line in outcome.log.splitlines() if "error" in line), outcome.log[-200:])
            raise CompileFailed(f"the compiler failed: {line.strip()}")
        return outcome.seconds, outcome.peak_memory


# A candidate: one way to evaluate one function; and how candidates are timed side by side.
#
# Candidates take turns: each round runs every one of them once, so that a slow moment of the machine falls on
# all. Ratios are taken round by round, and their median is what is reported. Times are processor time of this
# process, all its threads, so that others on the same core do not count.


FloatArray = NDArray[np.float64]

ROUNDS = 15
TARGET = 4e-3  # s that one turn takes
MOST_CALLS = 1_000_000


@dataclass
class Candidate:
    """One way to evaluate one function.

    name: row title; run: count -> seconds for that many calls; value: the result of the last call; side:
    "ours" or "peer"; called: from where ("C" or "Python"); per_call: evaluations in one call; built: how its
    code was compiled; made: seconds to make it, compiler included; kept: what must live as long as it does.
    """

    name: str
    run: Callable[[int], float]
    value: Callable[[], FloatArray]
    side: str = "peer"
    called: str = "Python"
    per_call: int = 1
    built: Built | None = None
    made: float | None = None
    kept: object = None


@dataclass(frozen=True)
class Timing:
    """Nanoseconds an evaluation, round by round."""

    rounds: FloatArray

    @property
    def median(self) -> float:
        """Median over the rounds [ns]."""
        return float(np.median(self.rounds))

    @property
    def spread(self) -> float:
        """Distance of the quartiles, as part of the median."""
        low, high = np.percentile(self.rounds, (25, 75))
        return float((high - low) / self.median)

    def times_faster_than(self, other: "Timing") -> float:
        """Return the median over rounds of other / self."""
        return float(np.median(other.rounds / self.rounds))


def repeat_python(call: Callable[[], object]) -> Callable[[int], float]:
    """Return run(count) -> seconds of processor time, for something that is called from Python."""

    def run(count: int) -> float:
        started = time.process_time()
        for _ in range(count):
            call()
        return time.process_time() - started

    return run


def measure(
    candidates: Sequence[Candidate], rounds: int = ROUNDS, target: float = TARGET
) -> dict[str, Timing]:
    """Return name -> timing of all candidates, which take turns for that many rounds of `target` [s] each."""
    counts = [_calibrate(candidate, target) for candidate in candidates]
    samples = np.empty((len(candidates), rounds))
    for turn in range(rounds):
        for index, (candidate, count) in enumerate(zip(candidates, counts, strict=True)):
            samples[index, turn] = candidate.run(count) / (count * candidate.per_call) * 1e9
    return {candidate.name: Timing(row) for candidate, row in zip(candidates, samples, strict=True)}


def _calibrate(candidate: Candidate, target: float) -> int:
    """Return how many calls take about `target` [s], after the first ones have warmed everything up."""
    count, taken = 1, max(candidate.run(1), 1e-9)
    while taken < target / 4 and count < MOST_CALLS:
        count *= 2
        taken = max(candidate.run(count), 1e-9)
    return max(1, min(MOST_CALLS, round(count * target / taken)))


Run = Callable[[int], float]
Array = NDArray[Any]


class Runner:
    """The compiled loops; every method returns run(count) -> seconds. Arrays are kept alive by it."""

    def __init__(self, compilation: Compilation, compiler: Compiler) -> None:
        source = Path(__file__).with_name("runner.c").read_text(encoding="utf-8")
        command = (*compiler.command, "-std=c99", "-O2", "-fPIC", "-shared", "runner.c")
        built = compilation.build({"runner.c": source}, command, version=compiler.version)
        self._library = ctypes.CDLL(built.path)
        for name in ("time_plain", "time_batch", "time_casadi", "time_pair"):
            getattr(self._library, name).restype = ctypes.c_double

    def plain(self, built: Built, symbol: str, arguments: Sequence[Array], result: Array) -> Run:
        """Time int f(const real *argument, ..., real *result)."""
        function, pointers = _symbol(built, symbol), _pointers(arguments)
        time, kept = self._library.time_plain, (arguments, result)
        fixed = (function, len(arguments), pointers, _address(kept[1]))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), kept)

    def batch(self, built: Built, symbol: str, arguments: Sequence[Array], result: Array) -> Run:
        """Time int f(int n_batch, const real *argument, int stride, ..., real *result, int *status).

        arguments, result: arrays with a leading batch axis.
        """
        function, pointers = _symbol(built, symbol), _pointers(arguments)
        strides = (ctypes.c_int * len(arguments))(*[array[0].size for array in arguments])
        time, kept = self._library.time_batch, (arguments, result)
        fixed = (function, len(arguments), len(result), pointers, strides, _address(kept[1]))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), kept)

    def casadi(self, built: Built, symbol: str, argument: Array, result: Array) -> Run:
        """Time a function of CasADi's C interface with one argument and one result."""
        function = _symbol(built, symbol)
        sizes = [ctypes.c_longlong() for _ in range(4)]
        getattr(ctypes.CDLL(built.path), f"{symbol}_work")(*map(ctypes.byref, sizes))
        n_arg, n_res, n_iw, n_w = (max(1, size.value) for size in sizes)
        arg, res = (ctypes.c_void_p * n_arg)(), (ctypes.c_void_p * n_res)()
        arg[0], res[0] = argument.ctypes.data, result.ctypes.data
        integers, work = np.zeros(n_iw, dtype=np.int64), np.zeros(n_w)
        time, kept = self._library.time_casadi, (argument, result, integers, work)
        fixed = (function, arg, res, _address(integers), _address(work))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), kept)

    def pair(self, function: Any, model: int, data: int) -> Run:
        """Time void f(const void *model, void *data) at two addresses."""
        time = self._library.time_pair
        fixed = (function, ctypes.c_void_p(model), ctypes.c_void_p(data))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), None)


def _symbol(built: Built, name: str) -> Any:
    return getattr(ctypes.CDLL(built.path), name)


def _address(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _pointers(arrays: Sequence[Array]) -> Any:
    return (ctypes.c_void_p * max(1, len(arrays)))(*[array.ctypes.data for array in arrays])


def _positive(seconds: float, kept: object) -> float:
    """Return the seconds; a negative answer means a signature that runner.c does not have."""
    if seconds < 0:
        raise TypeError("runner.c has no loop for this number of arguments")
    return float(seconds)


Way = tuple[str, Callable[[], Candidate]]  # title, and what makes the candidate or raises Unavailable

WANTED, MOST_COMPILERS = ("gcc", "clang", "zig"), 2  # zig cc is a clang


@dataclass(frozen=True)
class Tools:
    """compilers: gcc first where it is there; compilation: the folder of libraries; runner: timing loops."""

    compilers: tuple[Compiler, ...]
    compilation: Compilation
    runner: Runner


def find_tools(folder: Path, time_limit: float) -> Tools:
    """Return the tools of this machine; libraries go to `folder`, no compiler runs above time_limit [s]."""
    found = find_compilers()
    named = [compiler for name in WANTED for compiler in found if compiler.name == name][:MOST_COMPILERS]
    compilers = tuple(named) or found[:1]
    compilation = Compilation(folder, time_limit)
    return Tools(compilers, compilation, Runner(compilation, compilers[0]))
