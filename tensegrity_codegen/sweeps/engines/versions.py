"""Versions that must be equal wherever tasks of one sweep are computed, so that results are."""

import functools
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tensegrity_codegen.codegen.compilation.fingerprint import hash_package
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.system.errors import ClusterError
from tensegrity_codegen.system.version import VERSION

PACKAGES = ("numpy", "scipy", "casadi")
OWN = "tensegrity_codegen"
SOURCE = "source of tensegrity_codegen"


@functools.cache
def describe_versions() -> dict[str, str]:
    """Return the versions in this process, by name."""
    python = ".".join(platform.python_version_tuple()[:2])
    found = {OWN: VERSION, SOURCE: _hash_source(), "Python": python}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def check_versions(expected: Mapping[str, str], found: Mapping[str, str], worker: str) -> None:
    """Raise ClusterError, naming what differs, unless a worker has the versions of the client."""
    different = [name for name, value in expected.items() if found.get(name) != value]
    if different:
        raise ClusterError(
            "a worker has other versions than this process",
            where=f"worker {worker}",
            given=", ".join(f"{name} {found.get(name, 'not installed')}" for name in different),
            allowed=", ".join(f"{name} {expected[name]}" for name in different),
            hint="start the workers in the environment of this process, or in one with the same versions",
        )


def _hash_source() -> str:
    return hash_package(Path(__file__).resolve().parents[2], template_folder())[:12]
