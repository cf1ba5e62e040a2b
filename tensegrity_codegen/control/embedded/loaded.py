"""A compiled controller in this process, and its description in `manifest.json`."""

import json
import shutil
import tempfile
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.system.checks import check_path
from tensegrity_codegen.system.errors import (
    AbiMismatchError,
    InvalidValueError,
    LibraryError,
    UnknownNameError,
)
from tensegrity_codegen.tables.precision import find_precision

CONTROLLER_ABI = 1
KIND = "controller"
FloatArray = NDArray[Any]


@dataclass(frozen=True)
class ControllerDescription:
    """The description of a controller in C.

    Attributes
    ----------
    name : str
        First word of its names in C; the library is `<name>_control`.
    precision : str
        ``"double"`` or ``"single"``.
    sample, duration : float [s]
        Time between two steps, time of the motion.
    sizes, knots : mapping of str to int
        Numbers of coordinates, actuators and so on, as in the header; numbers of stored knots.
    actuators, coordinates, sensors, inputs : tuple of str
        Names, in the order of the arrays; the sensors of a policy are the numbers of its observation.
    statuses : tuple of str
        The status that steps return, by its number.
    table_bytes : int
        Memory of the constant tables.
    library : str
        File name of the shared library, ``""`` without one.
    declarations : str
        Types and functions of the header, as C.
    made_by : mapping of str to str
        Programs that wrote it, with versions.
    model : mapping or None
        Manifest of the model that it calls.
    policy : mapping or None
        Sizes, activation, output, bound and description of the policy that it runs.
    """

    name: str
    precision: str
    sample: float
    duration: float
    sizes: dict[str, int]
    knots: dict[str, int]
    actuators: tuple[str, ...]
    coordinates: tuple[str, ...]
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    statuses: tuple[str, ...]
    table_bytes: int
    library: str
    declarations: str
    made_by: dict[str, str]
    model: dict[str, Any] | None
    policy: dict[str, Any] | None = None

    def to_json(self) -> str:
        """Return it as JSON text, one line for each field."""
        data = {"kind": KIND, "abi_version": CONTROLLER_ABI, **asdict(self)}
        rows = (f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in data.items())
        return "{\n" + ",\n".join(rows) + "\n}\n"

    @classmethod
    def read(cls, path: Path) -> "ControllerDescription":
        """Read a manifest; raises LibraryError or AbiMismatchError."""
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise LibraryError(
                "no manifest of a controller", where=str(path), hint="build the controller again"
            ) from error
        except (ValueError, UnicodeDecodeError) as error:
            raise LibraryError("the manifest is damaged", where=str(path), hint="build it again") from error
        # Of this kind and version, with all fields.
        if not isinstance(data, dict) or data.get("kind") != KIND:
            raise LibraryError(
                "not the manifest of a controller", where=str(path), hint="a folder of build_controller"
            )
        if data.get("abi_version") != CONTROLLER_ABI:
            raise AbiMismatchError(
                "the controller was made for another version of the C interface",
                where=str(path),
                given=data.get("abi_version"),
                allowed=str(CONTROLLER_ABI),
                hint="build it again with this version of tensegrity_codegen",
            )
        try:
            values: dict[str, Any] = {
                field.name: data[field.name]
                for field in fields(cls)
                if field.name in data or field.default is MISSING
            }
        except KeyError as error:
            raise LibraryError("the manifest is damaged", where=str(path), hint="build it again") from error
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        return cls(**values)


class LoadedController:
    """A compiled controller with memory of its own; several of one folder are independent.

    Parameters
    ----------
    folder : Path
        Written by `build_controller` with its library.

    Attributes
    ----------
    description : ControllerDescription
        Names, sizes and precision.
    """

    def __init__(self, folder: Path) -> None:
        check_path(folder, "folder")
        folder = Path(folder)
        self.description = ControllerDescription.read(folder / "manifest.json")
        self._real = find_precision(self.description.precision)
        self._ffi = cffi.FFI()
        path = folder / self.description.library
        if not self.description.library:
            raise LibraryError(
                "the folder has no library", where=str(folder), hint="build it with library=True"
            )
        try:
            self._ffi.cdef(self.description.declarations)
            # A copy of its own: under a path that is loaded already the system returns the old library.
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as private:
                self._library = self._ffi.dlopen(shutil.copy(path, private))
        except (cffi.FFIError, cffi.CDefError, OSError) as error:
            raise LibraryError(
                "the controller does not load", where=str(path), given=str(error), hint="build it again"
            ) from error
        self._prefix = f"{self.description.name}_control"
        self._memory = self._ffi.new(f"{self._prefix} *")
        self._command = np.zeros(len(self.description.actuators), self._real.dtype)

    def __repr__(self) -> str:
        """Name, precision and how many actuators there are."""
        of = self.description
        return f"<LoadedController {of.name}: {len(of.actuators)} actuators, {of.precision} precision>"

    def init(self, coordinate: ArrayLike | None = None) -> str:
        """Begin at the start of the motion; return the status.

        Parameters
        ----------
        coordinate : array_like, shape (n_coordinates,), optional
            Where the structure is; by default at the start of the motion. A policy takes none.
        """
        if self.description.policy is not None and coordinate is None:
            return self._word(self._call("init")(self._memory))
        pointer = self._ffi.NULL
        if coordinate is not None:
            pointer = self._pointer(to_sized(coordinate, (len(self.description.coordinates),), "coordinate"))
        return self._word(self._call("init")(self._memory, pointer))

    def step(self, time: float, measured: ArrayLike | None) -> tuple[str, FloatArray]:
        """Return the status and the rest lengths (n_actuators,) [m] of a step from what is seen (n_y,)."""
        return self._step("step", (time,), measured, len(self.description.sensors), "measured")

    def step_state(self, time: float, state: ArrayLike | None) -> tuple[str, FloatArray]:
        """Return the status and the rest lengths (n_actuators,) [m] of a step from a state (n_states,)."""
        return self._step("step_state", (time,), state, 2 * len(self.description.coordinates), "state")

    def next(self, measured: ArrayLike | None) -> tuple[str, FloatArray]:
        """Return the result of `step`, one sample after the last step."""
        return self._step("next", (), measured, len(self.description.sensors), "measured")

    def next_state(self, state: ArrayLike | None) -> tuple[str, FloatArray]:
        """Return the result of `step_state`, one sample after the last step."""
        return self._step("next_state", (), state, 2 * len(self.description.coordinates), "state")

    def read(self, field: str) -> FloatArray:
        """Return a copy of an array in the memory of the controller, such as ``"command"``.

        ``"command"``: inputs of the actuators [m]; ``"wanted"``: before they were cut; ``"action"``: of the
        network of a policy; ``"estimate"``: coordinates, velocities, disturbance forces; ``"disturbance"``:
        force on each coordinate; ``"deviation"``: of the state from the motion, then sums; ``"input"``: all
        inputs; with a distribution of tensions ``"distribution.yields"``: members that actuators pull whose
        least tension yields, ``"distribution.iterations"``: most iterations of the solver in one program of
        the last step, ().
        """
        value = self._memory
        for name in str(field).split("."):
            value = getattr(value, name, None)
        if value is None:
            names = ", ".join(dir(self._memory))
            raise UnknownNameError("no such field", where="field", given=field, allowed=names)
        is_array = isinstance(value, self._ffi.CData)
        return np.array(self._ffi.unpack(value, len(value)) if is_array else value)

    def status_text(self, number: int) -> str:
        """Return the sentence of a status."""
        return str(self._ffi.string(self._call("status_text")(number)).decode("ascii"))

    def _step(
        self, name: str, before: tuple[float, ...], given: ArrayLike | None, size: int, where: str
    ) -> tuple[str, FloatArray]:
        call, values = self._call(name), self._ffi.NULL
        if given is not None:
            values = self._pointer(to_sized(given, (size,), where))
        try:
            status = call(self._memory, *map(float, before), values, self._pointer(self._command))
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidValueError(
                "not a time", where="time", given=before[0], allowed="a number [s]"
            ) from error
        return self._word(status), self._command.copy()

    def _pointer(self, values: FloatArray) -> Any:
        array = values if values is self._command else np.ascontiguousarray(values, self._real.dtype)
        return self._ffi.from_buffer(f"{self._real.c_type}[]", array)

    def _word(self, status: int) -> str:
        return self.description.statuses[status]

    def _call(self, name: str) -> Any:
        try:
            return getattr(self._library, f"{self._prefix}_{name}")
        except AttributeError as error:
            raise LibraryError(
                "the controller has no such function",
                where=self._prefix,
                given=name,
                hint="step and next need an estimator; without one call step_state",
            ) from error


def load_controller(folder: str | Path) -> LoadedController:
    """Load a compiled controller.

    Parameters
    ----------
    folder : str or Path
        Folder that `build_controller` wrote.

    Returns
    -------
    LoadedController
        Not yet initialised: call ``init`` first.

    Raises
    ------
    LibraryError
        There is no controller, it has no library, or it does not load.

    Examples
    --------
    >>> from tensegrity_codegen import build_controller, compile_scene, load_controller, plan, time_motion
    >>> model = compile_scene("prism12.toml", for_=("plan", "time_motion", "control"))
    >>> motion = time_motion(model, plan(model, "twist=157", steps=2), duration=1.0)
    >>> _ = build_controller(model, motion, out="prism_controller")
    >>> controller = load_controller("prism_controller")
    >>> controller.init(), controller.step_state(0.0, [0.0] * 36)[0]
    ('ok', 'ok')
    """
    check_path(folder, "folder")
    return LoadedController(Path(folder))
