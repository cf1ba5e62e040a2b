"""The verb `check`: a scene is read and checked, nothing is built."""

from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.options import JsonOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import name_list

if TYPE_CHECKING:
    from tensegrity_codegen.structure.bodies import BodySystem
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.tables.request import ModelRequest


MAX_BODIES = 12  # in the text
CONTROL: dict[str, Any] = {"actuators": [], "sensors": [], "limits": {}}


def check(scene: SceneArgument, json: JsonOption = False) -> None:
    """Check a scene and summarise it, without building anything; probable mistakes are warnings.

    Up to 1,500 members, self-stresses and mechanisms at the stated positions are counted.

    Example: tensegrity-codegen check prism.toml
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.pipeline.build_library import check_buildable
        from tensegrity_codegen.pipeline.compile_scene import load_scene
        from tensegrity_codegen.scene.checks.plausible_sizes import warn_of_imbalance
        from tensegrity_codegen.scene.checks.scene_warnings import find_scene_warnings
        from tensegrity_codegen.structure.outline import outline_tendons
        from tensegrity_codegen.structure.structure import Structure
        from tensegrity_codegen.system.summaries import describe_count
        from tensegrity_codegen.tables.body_places import CORNERS, EDGES

        structure, request = load_scene(scene)
        warnings = find_scene_warnings(structure)
        if isinstance(structure, Structure):
            warnings = (*warnings, *warn_of_imbalance(structure))
        check_buildable(structure, request)
        for warning in warnings:
            output.warn(warning)
        n_bars, n_cables = _count_bars(structure)
        bodies = _describe_bodies(structure) if isinstance(structure, Structure) else []
        n_nodes = outline_tendons(structure).n_nodes - CORNERS * len(bodies)
        data = {
            "status": "ok",
            "name": structure.name,
            "n_nodes": n_nodes,
            "n_bodies": len(structure.bodies),
            "n_bars": n_bars,
            "n_cables": n_cables,
            "n_coordinates": structure.n_coordinates,
            "axes": "".join("xyz"[axis] for axis in structure.axes),
            "formulation": request.formulation,
            "emitter": request.emitter,
            "precision": request.precision,
            "flags": request.flags,
            "batch_width": request.batch_width,
            "interfaces": request.interfaces,
            "quantities": request.quantities,
            "parameters": list(request.parameters),
            "inputs": [source.name for source in structure.inputs],
            **_describe_control(structure),
            **_describe_start(structure),
            "bodies": bodies,
            "ground": _describe_ground(structure),
            "warnings": warnings,
            "hints": _list_hints(structure, request),
        }
        counts = {"node": n_nodes, "bar": n_bars, "cable": n_cables}
        counts |= {"free coordinate": structure.n_coordinates - EDGES * len(bodies)}  # a body has six
        named = [describe_count(len(bodies), "body", "bodies")] if bodies else []
        finding = describe_count(len(warnings), "probable mistake") if warnings else "no mistake found"
        counted = ", ".join([*named, *(describe_count(count, kind) for kind, count in counts.items())])
        output.result(
            data,
            f"{structure.name}: {finding}; {counted}",
            *_summarise_start(data),
            *_summarise_bodies(bodies),
            f"requested: {', '.join(request.quantities)}",
            *_summarise_control(structure),
            *_summarise_ground(data["ground"]),
            *(f"hint: {hint}" for hint in data["hints"]),
        )


def _list_hints(structure: "Structure | BodySystem", request: "ModelRequest") -> list[str]:
    """Return a sentence on fixed steps across events, where the scene says nothing of these."""
    from tensegrity_codegen.codegen.integrators.events import describe_unwatched
    from tensegrity_codegen.tables.integrators import INTEGRATORS

    fixed = [name for name in request.integrators if INTEGRATORS[name].kind == "fixed"]
    unwatched = describe_unwatched(request, structure) if fixed and request.events is None else ""
    return [f"{', '.join(fixed)} in a library of build: {unwatched}"] if unwatched else []


def _describe_start(subject: "Structure | BodySystem") -> dict[str, Any]:
    """Return size, mass, tensions and counts of motions at the stated positions; None where not known."""
    import numpy as np

    from tensegrity_codegen.runtime.analysis.rank import count_freedom
    from tensegrity_codegen.structure.member_limits import summarise_tensions
    from tensegrity_codegen.structure.outline import hide_bodies, outline_tendons
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.tables.body_places import place_bodies

    structure = outline_tendons(subject)
    position = hide_bodies(structure).node_position
    bare = [body for body in structure.body_places if not body.point]
    if bare:
        position = np.concatenate([position, place_bodies(bare, structure.node_position)[0]])
    freedom = count_freedom(subject) if isinstance(subject, Structure) else None
    mass = subject.node_mass.sum() + subject.member_mass.sum() if isinstance(subject, Structure) else None
    return {
        "size": np.ptp(position, axis=0),
        "mass": mass,
        **summarise_tensions(structure, np.where(structure.is_rigid, np.nan, structure.static_tension())),
        **{
            name: getattr(freedom, name, None) for name in ("n_selfstress", "n_mechanisms", "n_rigid_motions")
        },
    }


def _summarise_start(data: dict[str, Any]) -> list[str]:
    """Return lines on sizes and tensions, and on self-stresses and motions where they were counted."""
    from tensegrity_codegen.structure.member_limits import describe_tensions
    from tensegrity_codegen.system.summaries import describe_count

    size = " x ".join(f"{side:.4g}" for side in data["size"])
    sizes = [f"size {size} m", *([] if data["mass"] is None else [f"mass {data['mass']:.6g} kg"])]
    sizes.append(f"tensions: {describe_tensions(data)}")
    if data["n_selfstress"] is None:
        return ["; ".join(sizes)]
    counts = [describe_count(data["n_selfstress"], "self-stress", "self-stresses")]
    counts += [describe_count(data["n_mechanisms"], "mechanism")]
    counts += [describe_count(data["n_rigid_motions"], "rigid motion")]
    return ["; ".join(sizes), f"{', '.join(counts)} at the stated positions"]


def _describe_control(subject: "Structure | BodySystem") -> dict[str, Any]:
    """Return actuators, sensors and limits, with the keys of a scene."""
    from tensegrity_codegen.scene.describe import describe_bodies, describe_control
    from tensegrity_codegen.structure.bodies import BodySystem

    if isinstance(subject, BodySystem):
        document = describe_bodies(subject)
        return {key: document.get(key, empty) for key, empty in CONTROL.items()}
    return describe_control(subject, "nodes", lambda i: subject.node_name[i])


def _summarise_control(subject: "Structure | BodySystem") -> list[str]:
    """Return lines on inputs, sensors and limits, none where there are none."""
    motors = {device.name for device in subject.actuators}
    inputs = [device.name for device in subject.inputs if device.name not in motors]
    stated = _describe_control(subject)["limits"]
    sensors = [f"{device.name or device.kind} ({len(device.targets)})" for device in subject.sensors]
    names = {"inputs": inputs, "actuators": [device.name for device in subject.actuators]}
    names |= {"sensors": sensors, "limits": list(stated)}
    return [f"{key}: {name_list(entries, most=10)}" for key, entries in names.items() if entries]


def _describe_ground(subject: "Structure | BodySystem") -> dict[str, Any] | None:
    """Return contacts, stiffness, and penetration and stick offset at rest; None without a ground."""
    from tensegrity_codegen.structure.contact_estimates import estimate_contacts, find_edge

    ground = subject.ground
    if ground is None:
        return None
    static_contacts = estimate_contacts(subject, ground)
    names = ("weight", "penetration", "largest_penetration", "frequency", "stick_offset")
    of_ground = {name: getattr(ground, name) for name in ("normal", "stiffness", "dissipation", "friction")}
    contacts = [subject.node_name[node] for node in ground.node]
    edge = find_edge(subject, ground) if static_contacts.weight > 0 else ()
    return {
        "contacts": contacts, **of_ground, **{name: getattr(static_contacts, name) for name in names},
        "stands_on_edge": [subject.node_name[node] for node in edge],
    }  # fmt: skip


def _describe_bodies(structure: "Structure") -> list[dict[str, Any]]:
    """Return of each rigid body mass, principal inertia, and of its balls on a ground height and frequency.

    height [m]: of the lowest ball above the ground, negative below; frequency [Hz]: of the lightest contact.
    """
    import numpy as np

    from tensegrity_codegen.structure.contact_estimates import compute_gap, estimate_contacts

    ground, rows = structure.ground, []
    at_rest = None if ground is None else estimate_contacts(structure, ground)
    for body in structure.bodies:
        facts: dict[str, Any] = {"name": body.name, "mass": body.mass}
        facts["principal_inertia"] = np.linalg.eigvalsh(body.inertia)
        facts |= dict.fromkeys(("lowest", "height", "contact_frequency"))
        balls = [] if ground is None else np.flatnonzero(np.isin(ground.node, body.point)).tolist()
        if ground is not None and at_rest is not None and balls:
            gap, lightest = compute_gap(structure, ground), float(at_rest.mass[balls].min())
            lowest = min(balls, key=lambda k: float(gap[k]))
            facts |= {"lowest": structure.node_name[ground.node[lowest]], "height": gap[lowest]}
            facts["contact_frequency"] = np.sqrt(at_rest.stiffness / lightest) / (2 * np.pi)
        rows.append(facts)
    return rows


def _summarise_bodies(bodies: list[dict[str, Any]]) -> list[str]:
    """Return a line on each of the first bodies."""
    lines = []
    for facts in bodies[:MAX_BODIES]:
        inertia = ", ".join(f"{value:.4g}" for value in facts["principal_inertia"])
        line = f"body {facts['name']}: mass {facts['mass']:.6g} kg, principal inertia {inertia} kg m2"
        if facts["lowest"] is not None:
            height = facts["height"]
            at = (
                f"is {height:.3g} m above the ground"
                if height > 0
                else f"touches the ground, {-height:.3g} m deep"
            )
            line += f"; {facts['lowest']} {at}, contact frequency {facts['contact_frequency']:.4g} Hz"
        lines.append(line)
    return [*lines, "more bodies with --json"] if len(bodies) > MAX_BODIES else lines


def _summarise_ground(ground: dict[str, Any] | None) -> list[str]:
    """Return a line on the ground, none without one."""
    from tensegrity_codegen.system.summaries import describe_count

    if ground is None:
        return []
    facts = [describe_count(len(ground["contacts"]), "contact")]
    if ground["weight"] > 0:
        weight = f"weight {ground['weight']:.4g} N"
        if len(ground["contacts"]) > 1:
            alone = ground["largest_penetration"]
            weight += f" in equal parts; {alone:.3g} m where one contact carries all"
        facts.append(f"penetration at rest {ground['penetration']:.3g} m ({weight})")
    facts.append(f"contact frequency {ground['frequency']:.4g} Hz")
    if ground["friction"] and ground["weight"] > 0:
        facts.append(f"stick offset at rest up to {ground['stick_offset']:.3g} m")
    lines, edge = [f"ground: {', '.join(facts)}"], ground["stands_on_edge"]
    if edge:
        kind = f"an edge, {' and '.join(edge)}" if len(edge) == 2 else f"a corner or line, {name_list(edge)}"
        lines.append(f"stands on {kind}: it tips; on_facet of [shape], or turned nodes, put a facet down")
    return lines


def _count_bars(subject: "Structure | BodySystem") -> tuple[int, int]:
    """Return the numbers of bars and of cables."""
    from tensegrity_codegen.structure.bodies import Bar, BodySystem

    if isinstance(subject, BodySystem):
        return sum(isinstance(body, Bar) for body in subject.bodies), subject.n_members
    return int((subject.is_bar & ~subject.is_edge).sum()), int((~subject.is_bar).sum())


VERB = Verb(check, order=20)
