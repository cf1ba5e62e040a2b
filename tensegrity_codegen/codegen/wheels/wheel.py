"""A wheel of a compiled library: names, tags, metadata and archive, the same bytes for the same library.

Formats: the Python packaging specifications of binary distributions, of core metadata and of names.
"""

import base64
import hashlib
import io
import re
import sysconfig
import zipfile
from collections.abc import Mapping
from pathlib import Path

from tensegrity_codegen.codegen.wheels import bundled
from tensegrity_codegen.codegen.wheels.module_text import format_module
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.system.errors import FormulationError, InvalidNameError
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import TARGETS, Target, find_target

PREFIX = "tensegrity_"
OWN_PACKAGE = "tensegrity_codegen"
NUMPY = "numpy>=1.26"
PYTHON = ">=3.10"
DATE = (1980, 1, 1, 0, 0, 0)  # the first that an archive can have
FILE_MODE = 0o644 << 16


def name_package(scene: str) -> str:
    """Return the name by which the package of a scene is imported; raises InvalidNameError."""
    name = PREFIX + scene
    if name == OWN_PACKAGE:
        raise InvalidNameError(
            "the Python package of this scene would have the name of the package that generates it",
            where="name",
            given=scene,
            allowed="any other name of a scene",
            hint=f"rename the scene, for example {scene}_scene",
        )
    return name


def name_distribution(scene: str) -> str:
    """Return the name by which the package of a scene is installed.

    Such names ignore case and runs of `_`; a scene whose name has them gets six digits of its hash.
    """
    plain = re.sub(r"_+", "_", name_package(scene)).strip("_").lower()
    if plain == PREFIX + scene:
        return plain
    return f"{plain}_{hashlib.sha256(scene.encode('utf-8')).hexdigest()[:6]}"


def check_wheel(target: Target, scene: str, where: str = "target") -> None:
    """Raise FormulationError, naming `where`, or InvalidNameError where there cannot be a wheel."""
    name_package(scene)
    if target.name and not target.wheel_tag:
        raise FormulationError(
            f"a {target.kind} is not a library that Python loads",
            where=where,
            given=target.name,
            allowed=", ".join(name for name, other in TARGETS.items() if other.wheel_tag),
            hint="build for one of these machines, or without a wheel",
        )


def build_wheel(manifest: Manifest, library: Path) -> tuple[str, bytes]:
    """Return file name and content of the wheel of a compiled library.

    manifest: what the library holds. Raises FormulationError, InvalidNameError: Python cannot load a library
    of this kind, or there is no package of this name.
    """
    if manifest.contact_name:
        raise refuse_ground(manifest.name, "a package of the library alone")
    check_wheel(find_target(manifest.target or None), manifest.name)
    package, name = name_package(manifest.name), name_distribution(manifest.name)
    version, tag = _version(manifest), _tag(manifest)
    files = {
        f"{package}/__init__.py": format_module(manifest, library.name, version).encode("utf-8"),
        f"{package}/_library.py": Path(bundled.__file__).read_bytes(),
        f"{package}/py.typed": b"",
        f"{package}/manifest.json": manifest.to_json().encode("utf-8"),
        f"{package}/{library.name}": library.read_bytes(),
    }
    info = f"{name}-{version}.dist-info"
    files[f"{info}/METADATA"] = _format_metadata(manifest, package, name, version).encode("utf-8")
    tags = "".join(f"Tag: py3-none-{part}\n" for part in tag.split("."))
    made = f"Wheel-Version: 1.0\nGenerator: tensegrity_codegen {VERSION}\nRoot-Is-Purelib: false\n"
    files[f"{info}/WHEEL"] = (made + tags).encode("utf-8")
    files[f"{info}/RECORD"] = _format_record(files, f"{info}/RECORD").encode("utf-8")
    return wheel_file_name(manifest), _pack(files)


def wheel_file_name(manifest: Manifest) -> str:
    """Return the file name of the wheel of a library."""
    return f"{name_distribution(manifest.name)}-{_version(manifest)}-py3-none-{_tag(manifest)}.whl"


def _version(manifest: Manifest) -> str:
    """Return the version of a wheel, another one for each scene and request."""
    return f"{VERSION}+g{manifest.scene_hash[:8]}"


def _tag(manifest: Manifest) -> str:
    """Return the platform tag; that of this machine makes no promise for other distributions of Linux."""
    if manifest.target:
        return TARGETS[manifest.target].wheel_tag
    return re.sub(r"[-.]", "_", sysconfig.get_platform())


def _format_metadata(manifest: Manifest, package: str, name: str, version: str) -> str:
    nodes, members = len(manifest.node_name), len(manifest.member_name)
    counts = f"{describe_count(nodes, 'node')} and {describe_count(members, 'member')}"
    functions = "\n".join(f"- `{package}.compute_{spec.quantity}`" for spec in manifest.functions)
    return (
        "Metadata-Version: 2.1\n"
        f"Name: {name.replace('_', '-')}\n"
        f"Version: {version}\n"
        f"Summary: Compiled library of the tensegrity structure {manifest.name}, {counts}\n"
        f"Requires-Python: {PYTHON}\n"
        f"Requires-Dist: {NUMPY}\n"
        "Classifier: Topic :: Scientific/Engineering :: Physics\n"
        "Classifier: Typing :: Typed\n"
        "Description-Content-Type: text/markdown\n"
        "\n"
        f"Import it as `{package}`. Written by tensegrity_codegen {VERSION} from a scene file;\n"
        f"`help({package})` describes functions, shapes and units.\n\n{functions}\n"
    )


def _format_record(files: Mapping[str, bytes], own: str) -> str:
    rows = []
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode("ascii")
        rows.append(f"{name},sha256={digest},{len(content)}\n")
    return "".join(rows) + f"{own},,\n"


def _pack(files: Mapping[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, FILE_MODE
            archive.writestr(entry, content)
    return packed.getvalue()
