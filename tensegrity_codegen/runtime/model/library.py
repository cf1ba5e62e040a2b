"""A loaded shared library: its symbols, checked against its manifest. No CasADi in here."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.binaries import describe_binary
from tensegrity_codegen.system.errors import AbiMismatchError, LibraryError, NonFiniteError
from tensegrity_codegen.tables.manifest import ABI_VERSION, STATUS, Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.targets import TARGETS, find_host

# The same names for the types of every library.
TYPES = {
    "run": "integrator_run",
    "event": "integrator_event",
    "profile": "integrator_profile",
    "equilibrium_report": "equilibrium_report",
}


def raise_for_status(status: int, where: str, arguments: Mapping[str, NDArray[Any]]) -> None:
    """Raise the error that a non-zero status stands for, naming the argument and entry at fault."""
    reason = STATUS[status] if 0 <= status < len(STATUS) else f"status {status}"
    if reason == "non_finite_input":
        for name, array in arguments.items():
            bad = np.argwhere(~np.isfinite(array))
            if bad.size:
                index = tuple(int(k) for k in bad[0])
                raise NonFiniteError(
                    f"argument {name!r} is not finite at {index}",
                    where=where,
                    given=float(array[index]),
                    allowed="finite numbers",
                )
    if reason == "non_finite_result":
        raise NonFiniteError(
            "the result is not finite",
            where=where,
            hint="look for nodes that coincide, a rest length or mass of zero, or an overflow",
        )
    raise LibraryError(f"the library returned the status {reason!r}", where=where)


class LoadedLibrary:
    """A generated library in this process, which has to fit its manifest."""

    def __init__(self, path: Path, manifest: Manifest) -> None:
        self.path = path
        self.precision = find_precision(manifest.precision)
        self.batch_width = manifest.batch_width
        _check_target(path, manifest)
        self.ffi = cffi.FFI()
        try:
            self.ffi.cdef(_declarations(manifest))
        except (cffi.FFIError, cffi.CDefError) as error:
            raise LibraryError("the manifest is damaged", where=str(path), hint="build it again") from error
        try:
            # Absolute: a bare file name would be looked up on the system's library path.
            self._library = self.ffi.dlopen(str(path.absolute()))
        except OSError as error:
            raise _explain_refusal(path, error) from error
        self._check_descriptor(manifest)
        self._check_machine(manifest.name)

    def symbol(self, name: str) -> Any:
        """Return the C function of that name."""
        try:
            return getattr(self._library, name)
        except (AttributeError, KeyError) as error:
            raise LibraryError(
                "the library lacks a function that its manifest lists",
                where=str(self.path),
                given=name,
                hint="build it again",
            ) from error

    def _check_descriptor(self, manifest: Manifest) -> None:
        descriptor = self.symbol(f"{manifest.name}_descriptor")
        if descriptor.abi_version != ABI_VERSION:
            raise AbiMismatchError(
                "the library was made for another version of the C interface",
                where=str(self.path),
                given=descriptor.abi_version,
                allowed=str(ABI_VERSION),
                hint="build it again with this version of tensegrity_codegen",
            )
        precision = self.ffi.string(descriptor.precision).decode("ascii", "replace")
        if precision != manifest.precision:
            raise AbiMismatchError(
                "library and manifest are of different precision",
                where=str(self.path),
                given=f"{precision} precision",
                allowed=f"{manifest.precision} precision",
                hint="build it again",
            )
        scene_hash = self.ffi.string(descriptor.scene_hash).decode("ascii", "replace")
        if scene_hash != manifest.scene_hash:
            raise AbiMismatchError(
                "library and manifest were made from different scenes",
                where=str(self.path),
                given=f"scene hash {scene_hash[:12]}",
                allowed=f"scene hash {manifest.scene_hash[:12]}",
                hint="build it again",
            )

    def _check_machine(self, name: str) -> None:
        """Raise LibraryError if the library's code needs instructions that this machine lacks."""
        if self.symbol(f"{name}_check_machine")() == 0:
            return
        find, missing = self.symbol(f"{name}_missing_instruction_set"), list[str]()
        while instruction_set := find(len(missing)):
            missing.append(self.ffi.string(instruction_set).decode("ascii", "replace"))
        raise LibraryError(
            "the library was compiled for instructions that this machine lacks",
            where=str(self.path),
            given=f"lacking {', '.join(missing)}",
            allowed="a machine like the one that it was compiled on",
            hint='build it with flags that suit every machine: `flags="reference"`',
        )


def _check_target(path: Path, manifest: Manifest) -> None:
    """Raise LibraryError for a library that was compiled for another machine."""
    if manifest.target and manifest.target != find_host():
        raise LibraryError(
            "the library was compiled for another machine, and cannot be loaded here",
            where=str(path),
            given=manifest.target,
            allowed=find_host(),
            hint="build it without `target`, or run it on that machine",
        )


def _explain_refusal(path: Path, error: OSError) -> LibraryError:
    """Return the error for a file that the system does not load; what it is for, where that is the reason."""
    try:
        with path.open("rb") as file:
            binary = describe_binary(file.read(2**16))
    except OSError:
        binary = ""
    here = TARGETS.get(find_host())
    if binary and here is not None and binary != here.binary:
        return LibraryError(
            "the library does not load: it is for another machine",
            where=str(path),
            given=binary,
            allowed=here.binary,
            hint="build it again",
        )
    return LibraryError("the library does not load", where=str(path), given=str(error), hint="build it again")


def _declarations(manifest: Manifest) -> str:
    """Return the declarations of the header, with the common names of its types."""
    declarations = manifest.declarations
    if not declarations:
        raise AbiMismatchError(
            "the manifest does not hold the declarations of the library",
            where=manifest.name,
            hint="build it again with this version of tensegrity_codegen",
        )
    common = [
        f"typedef {manifest.name}_{type_name} {name};"
        for type_name, name in TYPES.items()
        if f"}} {manifest.name}_{type_name};" in declarations
    ]
    return "\n".join((declarations, *common))
