"""Small scenes as text, to be spoiled."""

import math
from pathlib import Path

# Two nodes and a string, nothing special.
GOOD = """\
name = "small"

[classes.string]
kind = "cable"
spring_constant = 100.0
rest_length = 0.9

[nodes]
a = { position = [0, 0, 0], anchored = true }
b = { position = [0, 0, -1], mass = 1.0 }

[members]
s1 = { class = "string", nodes = ["a", "b"] }
"""

# The same, pulled down by its weight.
HANGING = GOOD.replace('name = "small"', 'name = "small"\ngravity = [0, 0, -9.81]')

# A frame of three bars in the plane that stands on two feet.
FRAME = """\
name = "frame"
axes = "xz"
gravity = [0, -9.81]
[classes.strut]
kind = "bar"
spring_constant = 1e4
[nodes]
left = { position = [0, 0], mass = 1 }
right = { position = [1, 0], mass = 1 }
top = { position = [0.5, 1], mass = 1 }
[members]
base = { class = "strut", nodes = ["left", "right"] }
west = { class = "strut", nodes = ["left", "top"] }
east = { class = "strut", nodes = ["right", "top"] }
[ground]
stiffness = 1e5
friction = 0.5
"""


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


# Two bars from anchors at x = -1 and 1 to a mass between them, at their rest lengths: it snaps through.
TRUSS = """\
name = "truss"
axes = "xz"
gravity = [0, {gravity}]
[nodes]
a = {{ position = [-1, 0], anchored = true }}
b = {{ position = [1, 0], anchored = true }}
c = {{ position = [0, {rise}], mass = 0.5 }}
[members]
ac = {{ kind = "bar", spring_constant = 1000, rest_length = {rest}, nodes = ["a", "c"] }}
bc = {{ kind = "bar", spring_constant = 1000, rest_length = {rest}, nodes = ["b", "c"] }}
"""
TRUSS_REST = math.hypot(1, 0.2)


def write_truss(folder: Path, gravity: float, rise: float = 0.2, load: str = "", name: str = "truss") -> Path:
    text = TRUSS.format(gravity=gravity, rise=rise, rest=repr(math.hypot(1, rise)))
    return write(folder / f"{name}.toml", text + load)
