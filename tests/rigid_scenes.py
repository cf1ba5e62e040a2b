"""Scenes with rigid bodies beside nodes and members."""

from typing import Any

CORD: dict[str, Any] = {"kind": "cable", "spring_constant": 400}
# A rod of parts that hangs turned from a hook, and a block with a spin and a skew inertia that hangs from it.
HANGING: dict[str, Any] = {
    "name": "hanging",
    "gravity": [0, 0, -9.81],
    "nodes": {"hook": {"position": [0.1, 0.0, 1.0], "anchored": True}},
    "bodies": {
        "rod": {
            "kind": "rigid",
            "parts": [
                {"kind": "cylinder", "radius": 0.01, "from": [0, 0, -0.2], "to": [0, 0, 0.2], "mass": 0.3},
                {"kind": "ball", "radius": 0.03, "position": [0, 0, 0.2], "mass": 0.1},
            ],
            "points": {"top": [0.01, 0.0, 0.2], "foot": {"position": [0, 0, -0.2], "radius": 0.01}},
            "position": [0.1, 0.0, 0.6],
            "axis": [0, 1, 0],
            "angle_deg": 30,
            "angular_velocity": [0.1, -0.2, 3.0],
        },
        "block": {
            "kind": "rigid",
            "mass": 0.5,
            "inertia": [[4e-4, 1e-5, 0], [1e-5, 5e-4, 0], [0, 0, 6e-4]],
            "centre_of_mass": [0, 0.01, 0],
            "parts": [{"kind": "box", "size": [0.06, 0.04, 0.05]}],
            "points": {"eye": [0, 0, 0.03]},
            "centre": [0.0, 0.0, 0.2],
            "centre_velocity": [0.2, 0, 0],
        },
    },
    "members": {
        "line": {"nodes": ["hook", "rod.top"], **CORD, "rest_length": 0.2},
        "tie": {"nodes": ["rod.foot", "block.eye"], **CORD, "rest_length": 0.18},
    },
}
