"""Small scenes as text, to be spoiled."""

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


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path
