"""A scene that is exported in tests."""

from pathlib import Path

# A prism that swings on its feet: cables go slack and taut; two inputs, parameters of four kinds, damping.
LOOSE = """
name = "loose"
gravity = [0, 0, -9.81]

[model]
quantities = ["member_tension", "total_energy"]

[parameters]
rest_length = ["verticals"]
node_load = ["t1"]
gravity = "all"
damping = ["bottom1"]

[groups]
verticals = ["vertical1", "vertical2", "vertical3"]

[classes.bar]
kind = "bar"
spring_constant = 2e4
mass = 0.05

[classes.cable]
kind = "cable"
spring_constant = 200
damping = 0.2

[shape]
kind = "prism"
bars = 3
bottom_radius = 0.15
height = 0.30
node_mass = 0.05
anchor_bottom = "z"
prestress = 1.0

[[loads]]
node = "t1"
force = [0.4, 0, -1]

[[inputs]]
name = "winch"
kind = "rest_length"
members = ["vertical1"]

[[inputs]]
name = "push"
kind = "force"
nodes = ["t2"]
direction = [0, 1, 0]
"""


def write_loose(folder: Path) -> Path:
    """Write the scene LOOSE to a folder; return its file."""
    path = folder / "loose.toml"
    path.write_text(LOOSE, encoding="utf-8")
    return path
