"""Whether a scene is a two-stage tower, by its bodies and classes of tendons (SCS 3)."""

from tensegrity_codegen.structure.bodies import Bar, BodyInput, BodySystem, RigidBody
from tensegrity_codegen.system.errors import StructureError

BARS = ("bar11", "bar21", "bar31", "bar12", "bar22", "bar32")
GROUPS = ("saddle", "vertical", "diagonal")
INPUTS = ("M1", "M2", "M3", "F1", "F2", "F3")


def find_top(system: BodySystem) -> RigidBody:
    """Return the only rigid body; StructureError if there are none or several."""
    rigid = [body for body in system.bodies if isinstance(body, RigidBody)]
    if len(rigid) != 1:
        raise StructureError(
            "a two-stage tower has one rigid top", where=system.name, given=[body.name for body in rigid]
        )
    return rigid[0]


def check_kind(system: BodySystem) -> None:
    """Raise StructureError unless bodies and classes of tendons are those of a two-stage tower."""
    bars = [body for body in system.bodies if isinstance(body, Bar)]
    held = {body.name: body.held for body in bars}
    expected = {name: "A" if name[-1] == "1" else "B" for name in BARS}
    plain = all(body.chart.axis == 2 and body.chart.polar == "declination" for body in bars)
    if held != expected or not plain or any(body.chart.offset for body in bars):
        raise StructureError(
            "not the bars of a two-stage tower",
            where=f"{system.name}: bodies",
            given=held,
            allowed=f"{', '.join(BARS)}; the first three held at A, the others at B, angles as in SCS (13)",
        )
    if sorted(set(system.member_class)) != sorted(GROUPS):
        raise StructureError(
            "not the tendons of a two-stage tower",
            where=f"{system.name}: tendons",
            given=sorted(set(system.member_class)),
            allowed=f"the classes {', '.join(GROUPS)}",
        )


def make_inputs(top: RigidBody, system: BodySystem) -> tuple[BodyInput, ...]:
    """Return M_1 to F_3 of SCS (15), along the axes of the top."""
    body, centre = system.bodies.index(top), f"{top.name}_centre"
    if centre not in system.node_name:
        raise StructureError(
            "the top needs a point at its centre, where F_3 acts",
            where=f"{system.name}: bodies.{top.name}",
            hint=f'name "{top.name}.centre" in a load or an input',
        )
    node = system.find_node(centre)
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    torques = [BodyInput(INPUTS[k], "torque", (body,), unit[k], "body") for k in range(3)]
    forces = [BodyInput(INPUTS[3 + k], "force", (node,), unit[k], "body") for k in range(3)]
    return (*torques, *forces)
