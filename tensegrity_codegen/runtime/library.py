"""A loaded shared library: its symbols, checked against its manifest. No CasADi in here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cffi

from tensegrity_codegen.errors import AbiMismatchError, LibraryError
from tensegrity_codegen.manifest import ABI_VERSION, FunctionSpec, IntegratorSpec, Manifest, SolverSpec

__all__ = ["LoadedLibrary"]

DESCRIPTION = """
typedef struct {
  int abi_version;
  char name[64];
  char scene_hash[65];
  char formulation[32];
  char emitter[32];
  char made_by[160];
} description;
"""

REPORT = """
typedef struct {
  int status;
  int iterations;
  int shifted;
  double contraction;
  double residual;
  double smallest_pivot;
  double potential_energy;
} equilibrium_report;
"""


class LoadedLibrary:
    """A generated library in this process, with every function of its manifest bound.

    path: the shared library; manifest: what it should hold. Raises LibraryError if the file does not
    load or lacks a symbol, AbiMismatchError if it was made for another interface version or scene.
    """

    def __init__(self, path: Path, manifest: Manifest) -> None:
        self.path = path
        self.ffi = cffi.FFI()
        self.ffi.cdef(_declarations(manifest))
        try:
            # Absolute: a bare file name would be looked up on the system's library path.
            self._library = self.ffi.dlopen(str(path.absolute()))
        except OSError as error:
            raise LibraryError(
                "the library does not load", where=str(path), given=str(error), hint="build it again"
            ) from error
        self._check_descriptor(manifest)

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
        found = self.symbol(f"{manifest.name}_descriptor")
        if found.abi_version != ABI_VERSION:
            raise AbiMismatchError(
                "the library was made for another version of the C interface",
                where=str(self.path),
                given=found.abi_version,
                allowed=str(ABI_VERSION),
                hint="build it again with this version of tensegrity_codegen",
            )
        scene_hash = self.ffi.string(found.scene_hash).decode("ascii", "replace")
        if scene_hash != manifest.scene_hash:
            raise AbiMismatchError(
                "library and manifest were made from different scenes",
                where=str(self.path),
                given=f"scene hash {scene_hash[:12]}",
                allowed=f"scene hash {manifest.scene_hash[:12]}",
                hint="build it again",
            )


def _declarations(manifest: Manifest) -> str:
    lines = [DESCRIPTION, f"extern description {manifest.name}_descriptor;"]
    lines += [_function_declaration(spec) for spec in manifest.functions]
    lines += [_integrator_declaration(spec) for spec in manifest.integrators]
    lines += [REPORT for _ in manifest.solvers[:1]]
    lines += [_solver_declaration(spec) for spec in manifest.solvers]
    return "\n".join(lines)


def _function_declaration(spec: FunctionSpec) -> str:
    return f"int {spec.symbol}({'const double *, ' * len(spec.arguments)}double *);"


def _integrator_declaration(spec: IntegratorSpec) -> str:
    passed = "const double *, " * len(spec.arguments)
    sampled = "long long, const double *, double *, long long *"
    if spec.name == "rk4":
        run = "double, double, long long, long long, double *"
        return f"int {spec.symbol}({run}, {passed}{sampled}, long long *, double *);"
    run = "double, double, double, long long, double *, double *, double *"
    return f"int {spec.symbol}({run}, {passed}{sampled}, long long *, long long *, double *);"


def _solver_declaration(spec: SolverSpec) -> str:
    passed = "const double *, " * len(spec.arguments)
    one = f"int {spec.symbol}(double *, {passed}double, int, equilibrium_report *, double *);"
    path = (
        f"int {spec.symbol}_path(const double *, long long, {passed}"
        "double, int, double *, equilibrium_report *, long long *, double *);"
    )
    return f"{one} {path}" if spec.varied else one
