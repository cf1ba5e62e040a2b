"""Checks of member laws: parameters that laws have, in range, on members that can have them."""

import numpy as np

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.tables.laws import LAW_PARAMETERS


def check_laws(subject: Structure | BodySystem, where: str) -> None:
    """Check the parameters of member laws.

    subject: whose members are checked; its other member arrays are sound; where: place of the subject, for
    messages.
    Raises UnknownNameError, NonFiniteError, InvalidValueError: with the member and key named.
    """
    for name, values in subject.law_parameter.items():
        _check_array(subject, name, values, where)
    rigid = (subject.spring_constant == 0) & (subject.axial_stiffness == 0)
    for law, mask in subject.members_of_law[1:]:
        refuse(
            mask & rigid,
            InvalidValueError,
            f"a rigid bar cannot be {law.name}",
            section="members",
            names=subject.member_name,
            where=where,
            allowed="only with spring_constant or axial_stiffness",
        )
        for rule in law.check(subject.member_values(), subject.tension_only):
            refuse(
                mask & rule.is_broken,
                InvalidValueError,
                rule.problem,
                section="members",
                names=subject.member_name,
                where=where,
                key=rule.key,
                given=subject.member_value(rule.key),
                allowed=rule.allowed,
            )


def _check_array(subject: Structure | BodySystem, name: str, values: object, where: str) -> None:
    """Check the name of a parameter, its shape, and that its values are finite."""
    place, array = key_path(where, "law_parameter", name), np.asarray(values)
    if name not in LAW_PARAMETERS:
        raise UnknownNameError(
            "no member law has this parameter", where=place, given=name, hint=suggest(name, LAW_PARAMETERS)
        )
    if array.shape != (subject.n_members,) or array.dtype.kind != "f":
        problem = "an array of the wrong shape or kind of number"
        allowed = f"float64 array of shape ({subject.n_members},)"
        raise InvalidValueError(problem, where=place, given=f"{array.dtype} {array.shape}", allowed=allowed)
    refuse(
        ~np.isfinite(array),
        NonFiniteError,
        "not a finite number",
        section="members",
        names=subject.member_name,
        where=where,
        key=name,
        given=array,
        allowed="finite numbers",
    )
