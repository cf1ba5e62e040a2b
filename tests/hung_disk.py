"""A rigid disk that hangs by three cables from anchors, its points loaded."""

from typing import Any

SCENE: dict[str, Any] = {
    "name": "hung",
    "gravity": [0, 0, -9.81],
    "nodes": {
        f"a{k}": {"position": [x, y, 1.0], "anchored": True}
        for k, (x, y) in enumerate([(0.2, 0), (-0.1, 0.2), (-0.1, -0.2)])
    },
    "bodies": {
        "disk": {
            "kind": "rigid",
            "mass": 0.5,
            "inertia": [0.004, 0.005, 0.006],
            "position": [0.0, 0.0, 0.5],
            "points": {
                f"p{k}": [x, y, 0.0] for k, (x, y) in enumerate([(0.1, 0), (-0.05, 0.1), (-0.05, -0.1)])
            },
        }
    },
    "members": {
        f"c{k}": {
            "kind": "cable",
            "spring_constant": 300.0,
            "rest_length": 0.4,
            "nodes": [f"a{k}", f"disk.p{k}"],
        }
        for k in range(3)
    },
    "loads": [{"node": "disk.p0", "force": [0.1, 0.0, 0.0]}],
}
