"""The XML tree of a model of MuJoCo with the files that it includes.

Files are only read, relative to the folder of the main file, as MuJoCo reads them, and names are checked.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

from tensegrity_codegen.scene.formats.files.documents import read_attribute, read_xml
from tensegrity_codegen.scene.names import check_known
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError

MAX_INCLUDED = 200  # files of one model
ROOTS = ("mujoco", "mujocoinclude")
IN_BODIES = (
    "inertial joint freejoint geom site camera light body frame attach composite flexcomp replicate plugin"
)
# Elements of MuJoCo in others; an element that it does not have is refused, as there.
ELEMENTS = dict.fromkeys(("worldbody", "body", "frame", "replicate"), IN_BODIES) | {
    "actuator": "general motor position velocity intvelocity orientation pid damper cylinder muscle adhesion "
    "dcmotor plugin",
    "sensor": "touch accelerometer velocimeter gyro force torque magnetometer camprojection rangefinder "
    "jointpos jointvel tendonpos tendonvel actuatorpos actuatorvel actuatorfrc jointactuatorfrc "
    "tendonactuatorfrc ballquat ballangvel jointlimitpos jointlimitvel jointlimitfrc "
    "tendonlimitpos tendonlimitvel tendonlimitfrc framepos framequat framexaxis frameyaxis "
    "framezaxis framelinvel frameangvel framelinacc frameangacc subtreecom subtreelinvel "
    "subtreeangmom insidesite distance normal fromto contact e_potential e_kinetic clock "
    "tactile user plugin",
}
SECTIONS = ("tendon", "actuator", "sensor", "equality")  # whose elements share their names; others by tag


def read_model(path: Path, what: str) -> Element:
    """Return the root of a model, with the content of included files in place of their elements."""
    root = read_xml(path, what)
    if root.tag != "mujoco":
        raise InvalidValueError(
            "not a model of MuJoCo", where=str(path), given=root.tag[:80], allowed="<mujoco>"
        )
    _expand(root, path, path.parent, [path.resolve()])
    _check_names(root, path)
    for section in root:
        for element in section.iter() if section.tag != "default" else ():
            tags = ELEMENTS.get(element.tag, "").split()
            for child in element if tags else ():
                if isinstance(child.tag, str):
                    location = f"{path}: {element.tag} {element.get('name', '')[:60]}".rstrip()
                    check_known(child.tag, tags, "MuJoCo has no such element", "", location)
    return root


def _check_names(root: Element, path: Path) -> None:
    """Raise DuplicateNameError for a name that two elements of one kind have, as MuJoCo refuses it."""
    seen: set[tuple[str, str]] = set()
    for section in root:
        for element in section.iter():
            tag, name = element.tag, element.get("name", "")
            kind = section.tag if section.tag in SECTIONS else "joint" if tag == "freejoint" else tag
            if name and (kind, name) in seen:
                problem, where = f"two elements <{tag}> with one name", f"{path}: {tag} {name[:60]}"
                allowed, hint = f"each name of a {kind} once, as in MuJoCo", "rename one of them"
                raise DuplicateNameError(problem, where=where, given=name[:80], allowed=allowed, hint=hint)
            seen.add((kind, name))


def _expand(element: Element, path: Path, folder: Path, read: list[Path]) -> None:
    """Replace the elements `include` below an element of `path`; read: the files that were read so far."""
    children: list[Element] = []
    for child in element:
        if child.tag == "include":
            children += _include(child, path, folder, read)
        else:
            _expand(child, path, folder, read)
            children.append(child)
    element[:] = children


def _include(element: Element, path: Path, folder: Path, read: list[Path]) -> list[Element]:
    where = f"{path}: include"
    name = read_attribute(element, "file", where)
    target = folder / name
    if target.resolve() in read or len(read) > MAX_INCLUDED:
        problem, allowed = "the file is included twice, or includes itself", "each file once, as in MuJoCo"
        raise InvalidValueError(problem, where=where, given=name[:80], allowed=allowed)
    read.append(target.resolve())
    root = read_xml(target, f"a part of {path}, which includes it")
    if root.tag not in ROOTS:
        problem = "the included file is no part of a model"
        raise InvalidValueError(problem, where=where, given=root.tag[:80], allowed=" or ".join(ROOTS))
    _expand(root, target, folder, read)
    return list(root)
