"""A small importer of FMI 2.0 units through ctypes, written from the standard: what tests need of one."""

import ctypes as c
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
LOGGER = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)
ALLOCATE = c.CFUNCTYPE(c.c_void_p, c.c_size_t, c.c_size_t)
RELEASE = c.CFUNCTYPE(None, c.c_void_p)
OK = 0


class Callbacks(c.Structure):
    _fields_ = [
        ("logger", LOGGER),
        ("allocateMemory", ALLOCATE),
        ("freeMemory", RELEASE),
        ("stepFinished", c.c_void_p),
        ("componentEnvironment", c.c_void_p),
    ]


class EventInfo(c.Structure):
    _fields_ = [*((f"flag{k}", c.c_int) for k in range(5)), ("time", c.c_double)]


class Unit2:
    """One instance. Memory is counted: `held` is what the unit has not given back."""

    def __init__(self, path: Path, folder: Path, kind: str, token: str | None = None) -> None:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        self.description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.reference = {
            item.get("name"): int(item.get("valueReference") or -1)
            for item in self.description.iter("ScalarVariable")
        }
        binary = next((folder / "binaries").rglob(f"{self.description.get('modelName')}.*"))
        self.library = c.CDLL(str(binary))
        self.library.fmi2Instantiate.restype = c.c_void_p
        self.held: dict[int, Any] = {}
        self.messages: list[tuple[int, str]] = []
        self._callbacks = Callbacks(
            LOGGER(lambda _, name, status, category, text: self.messages.append((status, text.decode()))),
            ALLOCATE(self._allocate),
            RELEASE(lambda memory: self.held.pop(memory, None) and None),
        )
        guid = (self.description.get("guid") or "") if token is None else token
        number = {"me": 0, "cs": 1}[kind]
        self.instance = c.c_void_p(
            self.library.fmi2Instantiate(b"one", number, guid.encode(), b"", c.byref(self._callbacks), 0, 1)
        )

    def _allocate(self, count: int, size: int) -> int:
        memory = c.create_string_buffer(count * size)
        address = c.addressof(memory)
        self.held[address] = memory
        return address

    def call(self, name: str, *arguments: Any) -> int:
        """Call a function of the instance, without its prefix; return the status."""
        return int(getattr(self.library, f"fmi2{name}")(self.instance, *arguments))

    def good(self, name: str, *arguments: Any) -> None:
        assert self.call(name, *arguments) == OK, (name, self.messages)

    def start(self, rtol: float = 1e-6, **values: float) -> None:
        """Go through the initialization; values: by names with _ for dots are not guessed, see `set`."""
        self.good("SetupExperiment", 1, c.c_double(rtol), c.c_double(0.0), 0, c.c_double(0.0))
        self.good("EnterInitializationMode")
        self.good("ExitInitializationMode")

    def references(self, names: Sequence[str]) -> Any:
        return (c.c_uint * len(names))(*(self.reference[name] for name in names))

    def set(self, **values: float) -> int:
        return self.set_all(values)

    def set_all(self, values: dict[str, float]) -> int:
        numbers = (c.c_double * len(values))(*values.values())
        return self.call("SetReal", self.references(list(values)), c.c_size_t(len(values)), numbers)

    def get(self, *names: str) -> Array:
        values = (c.c_double * len(names))()
        self.good("GetReal", self.references(names), c.c_size_t(len(names)), values)
        return np.array(values)

    def flag(self, name: str) -> int:
        value = c.c_int()
        self.good("GetBoolean", self.references([name]), c.c_size_t(1), c.byref(value))
        return value.value

    def count(self, name: str = "event_count") -> int:
        value = c.c_int()
        self.good("GetInteger", self.references([name]), c.c_size_t(1), c.byref(value))
        return value.value

    def step(self, time: float, size: float) -> int:
        return self.call("DoStep", c.c_double(time), c.c_double(size), 1)

    def derivative(self, unknowns: Sequence[str], knowns: Sequence[str], seed: Sequence[float]) -> Array:
        found = (c.c_double * len(unknowns))()
        self.good(
            "GetDirectionalDerivative",
            self.references(unknowns),
            c.c_size_t(len(unknowns)),
            self.references(knowns),
            c.c_size_t(len(knowns)),
            (c.c_double * len(seed))(*seed),
            found,
        )
        return np.array(found)

    def store(self) -> c.c_void_p:
        state = c.c_void_p()
        self.good("GetFMUstate", c.byref(state))
        return state

    def enter_events(self) -> None:
        info = EventInfo()
        self.good("EnterEventMode")
        self.good("NewDiscreteStates", c.byref(info))
        self.good("EnterContinuousTimeMode")

    def integrate(self, t_end: float, n_states: int, n_indicators: int, rtol: float) -> list[float]:
        """Integrate as an importer of model exchange does, by SciPy between events; return their times."""

        def rate(time: float, state: Array) -> Array:
            self.put(time, state)
            values = (c.c_double * n_states)()
            self.good("GetDerivatives", values, c.c_size_t(n_states))
            return np.array(values)

        def indicators(time: float, state: Array) -> Array:
            self.put(time, state)
            values = (c.c_double * n_indicators)()
            self.good("GetEventIndicators", values, c.c_size_t(n_indicators))
            return np.array(values)

        def find(k: int) -> Any:
            def crossing(time: float, state: Array) -> float:
                return float(indicators(time, state)[k]) - before[k]

            crossing.terminal = True  # type: ignore[attr-defined]
            return crossing

        info, values, times, time = EventInfo(), (c.c_double * n_states)(), [], 0.0
        self.good("NewDiscreteStates", c.byref(info))
        self.good("EnterContinuousTimeMode")
        self.good("GetContinuousStates", values, c.c_size_t(n_states))
        state = np.array(values)
        while time < t_end:
            # A root lies a hair behind zero, so that it is passed when it is found.
            side = np.sign(indicators(time, state))
            before = -1e-12 * side
            run = solve_ivp(
                rate,
                (time, t_end),
                state,
                method="DOP853",
                rtol=rtol,
                atol=1e-3 * rtol,
                events=[find(k) for k in range(n_indicators)],
            )
            assert run.success
            time, state = float(run.t[-1]), run.y[:, -1]
            self.put(time, state)
            if run.status == 1:
                times.append(time)
                self.enter_events()
        return times

    def put(self, time: float, state: Array) -> None:
        self.good("SetTime", c.c_double(time))
        self.good("SetContinuousStates", (c.c_double * len(state))(*state), c.c_size_t(len(state)))

    def free(self) -> None:
        self.library.fmi2FreeInstance(self.instance)
