"""Attributes of MJCF elements with those of their default classes; those that act unread are named."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from tensegrity_codegen.scene.formats.files.documents import check_attributes
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError

_FRAME = "pos quat axisangle xyaxes zaxis euler"
_LOOKS = "name class group user material rgba"
_SOLVER = "margin limited actuatorfrclimited solreflimit solimplimit solreffriction solimpfriction"
_CONTACT = "contype conaffinity condim friction solmix solref solimp margin gap priority adhesion surfacevel"
_TENDON = f"{_LOOKS} {_SOLVER} width stiffness damping springlength"
_ACTUATOR = f"{_LOOKS} site refsite tendon gear gainprm biasprm biastype actlimited ctrllimited forcelimited"
# By element: attributes that are read or change no motion.
TAKEN = {
    "compiler": "angle eulerseq autolimits alignfree assetdir conflict coordinate discardvisual fitaabb "
    "inertiafromgeom inertiagrouprange "
    "fusestatic meshdir passthrough savecanonical savecompiled saveinertial strippath texturedir usethread",
    "option": "gravity timestep apirate impratio tolerance ls_tolerance noslip_tolerance ccd_tolerance "
    "sleep_tolerance mpr_tolerance o_margin o_solref o_solimp o_friction integrator cone jacobian solver "
    "iterations ls_iterations noslip_iterations ccd_iterations sdf_iterations mpr_iterations sdf_initpoints "
    "magnetic collision",
    "flag": "gravity constraint equality frictionloss limit contact clampctrl warmstart filterparent refsafe "
    "sensor midphase nativeccd multiccd eulerdamp autoreset override energy fwdinv invdiscrete island sleep "
    "diagexact ipc speculative sensornoise",
    "body": f"{_LOOKS} {_FRAME} childclass sleep simple fuse",
    "joint": f"{_LOOKS} {_SOLVER} type axis pos ref springref",
    "freejoint": "name group align",
    "geom": f"{_LOOKS} {_FRAME} {_CONTACT} type size fromto mass density castshadow fluidshape fluidcoef",
    "site": f"{_LOOKS} {_FRAME} type size fromto mesh",
    "pair": f"name class geom1 geom2 {_CONTACT}",
    "spatial": _TENDON,
    "fixed": f"{_TENDON} armature",
    "key": "name time qpos qvel act ctrl mpos mquat",
    "general": f"{_ACTUATOR} lengthrange nsample interp cranklength inheritrange actdim",
}
TAKEN |= dict.fromkeys(("motor", "position", "velocity"), f"{TAKEN['general']} inheritrange")
_WORDS = {tag: frozenset(words.split()) for tag, words in TAKEN.items()}
# Values without effect of attributes, besides IDLE and zeros.
OWN_IDLE = {"settotalmass": "-1", "inertiagrouprange": "0 5", "dynprm": "1 0 0", "gaintype": "fixed"}
IDLE = ("false", "auto", "none", "enable")


def list_unread(tag: str, values: Mapping[str, str], by_range: bool) -> list[str]:
    """Return the attributes that act in MuJoCo and are not read; by_range: ranges act by themselves."""
    read_keys = _WORDS[tag]
    unread = [key for key, value in values.items() if key not in read_keys and not _is_idle(key, value)]
    if not unread:
        return []
    # A range acts where, for instance, ctrllimited of ctrlrange is true.
    states = {f"{key[:-7]}range": values.get(key, "auto") for key in read_keys if key.endswith("limited")}
    off = ("false",) if by_range else ("false", "auto")
    return [key for key in unread if states.get(key) not in off]


def _is_idle(key: str, value: str) -> bool:
    value = " ".join(value.split())
    return value == OWN_IDLE.get(key) or value in IDLE or set(value) <= set("0. +-")


MAIN = "main"
MAX_NAMED = 10
# Elements of classes; all others there are actuators, whose attributes are those of one element.
KINDS = ("joint", "geom", "site", "tendon", "mesh", "material", "camera", "light", "pair", "equality")
# Elements that change the meaning of a file and are not read.
REFUSED = ("attach", "replicate", "composite", "flexcomp", "flex", "extension", "model")


class Defaults:
    """Attributes by class and element; a class has those of the classes around it too.

    unread: by element and attribute, the elements whose attribute acts in MuJoCo and is not read.
    """

    def __init__(
        self, classes: Mapping[str, Mapping[str, Mapping[str, str]]], file: str, by_range: bool
    ) -> None:
        self._classes, self._file, self._by_range = classes, file, by_range
        self.unread: dict[str, list[str]] = {}

    def complete(self, element: Element, kind: str, around: str = MAIN, owner: str = "") -> dict[str, str]:
        """Return the attributes of an element, and record those that are not read.

        kind: its name in classes; around: class of its body; owner: what has it, where it has no name.
        """
        self.record(element.tag, values := self.inherit(element, kind, around), owner)
        return values

    def record(self, tag: str, values: Mapping[str, str], owner: str = "") -> None:
        """Record the attributes of an element that act in MuJoCo and are not read."""
        for key in list_unread(tag, values, self._by_range):
            names = self.unread.setdefault(f"{tag} {key[:40]}", [])
            is_named = len(names) < MAX_NAMED  # of the others only the number is told
            description = f"{values.get('name', owner)[:60]} ({values[key][:40]})" if is_named else ""
            names.append(description.lstrip())

    def is_limited(self, values: Mapping[str, str], kind: str) -> bool:
        """Return whether the range of an element acts; kind: "ctrl" or "force"."""
        limited = values.get(f"{kind}limited", "auto")
        return f"{kind}range" in values and (limited == "true" or (limited == "auto" and self._by_range))

    def inherit(self, element: Element, kind: str, around: str = MAIN) -> dict[str, str]:
        """Return the attributes of an element with those of its class."""
        chosen = element.get("class", around)
        if chosen not in self._classes:
            location = f"{self._file}: {element.tag} {element.get('name', '')[:60]}"
            allowed = "a default class of the file"
            raise UnknownNameError("unknown class", where=location, given=chosen[:80], allowed=allowed)
        return {**self._classes[chosen].get(kind, {}), **element.attrib}


def read_defaults(root: Element, file: str) -> Defaults:
    """Return the default classes of a model; raises InvalidValueError for elements that are not read."""
    bound = [element for section in root.iterfind("equality") for element in section]
    active = [element for element in bound if element.get("active", "true") == "true"]
    for element in [*active, *(element for element in root.iter() if element.tag in REFUSED)]:
        problem = f"the element <{element.tag}> is not read"
        allowed = "bodies, frames, joints, sites, geoms, spatial tendons, files by include"
        hint = "let MuJoCo write the model (mj_saveLastXML), which expands it"
        if element in active:
            problem, hint = f"the constraint <{element.tag}> is not read", "make one body of what it joins"
        raise InvalidValueError(problem, where=file, given=element.tag, allowed=allowed, hint=hint)
    classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}

    def visit(element: Element, name: str, inherited: Mapping[str, dict[str, str]]) -> None:
        attributes = dict(inherited)
        for child in element:
            if child.tag != "default":
                kind = child.tag if child.tag in KINDS else "actuator"
                attributes[kind] = {**attributes.get(kind, {}), **child.attrib}
                check_attributes(attributes[kind], child.tag, file)
        classes[name] = attributes
        for child in element.iterfind("default"):
            visit(child, child.get("class", ""), attributes)

    for element in root.iterfind("default"):
        visit(element, element.get("class", MAIN), classes[MAIN])
        if element.get("class", MAIN) != MAIN:
            classes.setdefault(MAIN, {})
    by_range = [element.get("autolimits") for element in root.iterfind("compiler[@autolimits]")]
    return Defaults(classes, file, by_range[-1:] != ["false"])
