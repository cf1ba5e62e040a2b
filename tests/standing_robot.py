"""A robot of three rods with motors, rigid bodies, that stands on the ground on the balls at their ends."""

from typing import Any

import numpy as np

ENDS = ("lo", "hi")
OFF_AXIS = {"bo": (0.018, 0.0, -0.17), "bi": (-0.018, 0.0, -0.17), "to": (0.018, 0.0, 0.17)}
OFF_AXIS |= {"ti": (-0.018, 0.0, 0.17), "vl": (0.0, 0.018, -0.17), "vh": (0.0, 0.018, 0.17)}
ROW = ((400.0, 0.15, "b", "bo", "bi"), (400.0, 0.15, "t", "to", "ti"), (600.0, 0.18, "v", "vl", "vh"))


def describe_robot(*, on_ground: bool = True, damping: float = 2.0, winches: int = 3) -> dict[str, Any]:
    """Return the scene: three rods, nine cables beside their axes, winches in the first of these."""
    bodies, members = {}, {}
    points = {name: list(place) for name, place in OFF_AXIS.items()}
    for name, height in zip(ENDS, (-0.18, 0.18), strict=True):
        points[name] = {"position": [0.0, 0.0, height], "radius": 0.025}  # type: ignore[assignment]
    for k in range(3):
        foot, head = (2 * np.pi * k / 3 + turn for turn in (0.0, 5 * np.pi / 6))
        bodies[f"rod{k}"] = {
            "kind": "rigid",
            "mass": 0.25,
            "inertia": [0.0026, 0.0026, 5e-5],
            "points": points,
            "from": [0.12 * np.cos(foot), 0.12 * np.sin(foot), 0.030],
            "to": [0.12 * np.cos(head), 0.12 * np.sin(head), 0.25],
        }
        for stiffness, length, letter, first, second in ROW:
            other = (k + (2 if letter == "v" else 1)) % 3
            members[f"{letter}{k}"] = {
                "kind": "cable",
                "spring_constant": stiffness,
                "rest_length": length,
                "damping": damping,
                "nodes": [f"rod{k}.{first}", f"rod{other}.{second}"],
            }
    scene = {"name": "robot", "gravity": [0, 0, -9.81 * on_ground], "bodies": bodies, "members": members}
    names = list(members)[:winches]
    scene["actuators"] = [
        {"name": f"w{k}", "members": name, "rate": 0.2, "range": [0.05, 0.3]} for k, name in enumerate(names)
    ]
    if on_ground:
        stick = {"friction": 0.6, "stick_stiffness": 2e4, "stick_damping": 40.0}
        scene["ground"] = {"stiffness": 2e4, "dissipation": 0.3, **stick}
    return scene
