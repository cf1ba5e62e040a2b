"""Attributes of MJCF elements that are read or change no motion; every other one is named where it acts."""

from collections.abc import Mapping

_FRAME = "pos quat axisangle xyaxes zaxis euler"
_LOOKS = "name class group user material rgba"
_SOLVER = "margin limited actuatorfrclimited solreflimit solimplimit solreffriction solimpfriction"
_CONTACT = "contype conaffinity condim friction solmix solref solimp margin gap priority adhesion surfacevel"
_TENDON = f"{_LOOKS} {_SOLVER} width stiffness damping springlength"
_ACTUATOR = f"{_LOOKS} site refsite tendon gear gainprm biasprm biastype actlimited ctrllimited forcelimited"
# By element: what is read, and what changes no motion.
TAKEN = {
    "compiler": "angle eulerseq autolimits alignfree assetdir conflict coordinate discardvisual fitaabb "
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
    "spatial": _TENDON,
    "fixed": f"{_TENDON} armature",
    "general": f"{_ACTUATOR} lengthrange nsample interp cranklength inheritrange actdim",
}
TAKEN["motor"] = TAKEN["general"]
_WORDS = {tag: frozenset(words.split()) for tag, words in TAKEN.items()}
# Values with which an attribute does nothing, where it is neither one of IDLE nor zeros.
OWN_IDLE = {"settotalmass": "-1", "inertiagrouprange": "0 5", "dynprm": "1 0 0", "gaintype": "fixed"}
IDLE = ("false", "auto", "none", "enable")


def list_unread(tag: str, values: Mapping[str, str], by_range: bool) -> list[str]:
    """Return the attributes of an element that act in MuJoCo and are not read.

    by_range: whether ranges act where nothing else is said (`autolimits`).
    """
    taken = _WORDS[tag]
    unread = [key for key, value in values.items() if key not in taken and not _is_idle(key, value)]
    if not unread:
        return []
    # A range acts where, for instance, ctrllimited of ctrlrange is true.
    states = {f"{key[:-7]}range": values.get(key, "auto") for key in taken if key.endswith("limited")}
    off = ("false",) if by_range else ("false", "auto")
    return [key for key in unread if states.get(key) not in off]


def _is_idle(key: str, value: str) -> bool:
    value = " ".join(value.split())
    return value == OWN_IDLE.get(key) or value in IDLE or set(value) <= set("0. +-")
