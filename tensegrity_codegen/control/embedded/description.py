"""What a controller in C says of itself: its `manifest.json`."""

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from tensegrity_codegen.system.errors import AbiMismatchError, LibraryError

CONTROLLER_ABI = 1
KIND = "controller"


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
        Names, in the order of the arrays.
    statuses : tuple of str
        What steps return, by its number.
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
            given: dict[str, Any] = {item.name: data[item.name] for item in fields(cls)}
        except KeyError as error:
            raise LibraryError("the manifest is damaged", where=str(path), hint="build it again") from error
        given = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
        return cls(**given)
