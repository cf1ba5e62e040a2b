"""What a command took, as rows of a table; the structures that it is asked about."""

import os
import sys

import numpy as np
import pytest
from time_to_answer import STRUCTURES, Run, describe_end, describe_run, measure, take_median, write_dome

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure


def load(text: str) -> Structure:
    import tomllib

    return assemble(parse_scene(tomllib.loads(text)))[0]


@pytest.mark.parametrize("name", ["prism", "dome", "tower"])
def test_names_state_the_number_of_members(name: str) -> None:
    title, write = STRUCTURES[name]
    assert title.endswith(f" {load(write()).n_members}")


def test_the_prestress_of_the_dome_is_in_equilibrium() -> None:
    dome = load(write_dome())
    ends = dome.node_position[dome.connectivity[:, 1]] - dome.node_position[dome.connectivity[:, 0]]
    length = np.linalg.norm(ends, axis=1)
    tension = (dome.axial_stiffness / dome.rest_length) * (length - dome.rest_length)
    force = np.zeros_like(dome.node_position)
    np.add.at(force, dome.connectivity[:, 0], (tension / length)[:, None] * ends)
    np.add.at(force, dome.connectivity[:, 1], -(tension / length)[:, None] * ends)
    free = ~dome.node_anchored.any(axis=1)
    assert np.abs(force[free]).max() < 1e-9 * np.abs(tension).max()


def test_a_command_is_measured_with_its_children() -> None:
    work = "sum(range(3_000_000)); print(1)"
    text = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {work!r}]); print(2)"
    run = measure((sys.executable, "-c", text), dict(os.environ), 60.0)
    alone = measure((sys.executable, "-c", "print(2)"), dict(os.environ), 60.0)
    assert (run.lines, run.ended) == (2, "")
    assert run.cpu > alone.cpu
    assert run.memory > 1.0


def test_what_takes_too_long_is_given_up() -> None:
    run = measure((sys.executable, "-c", "import time; time.sleep(60)"), dict(os.environ), 0.2)
    assert (run.lines, run.ended) == (0, "after 0.2 s")


def test_an_end_says_why() -> None:
    assert describe_end(0, "fine") == ""
    assert describe_end(2, "error: no loads | given\nhint: add one\n") == "2: error: no loads / given"
    assert describe_end(3, "not stable\n") == "3: not stable"
    assert describe_end(-9, "") == "-9: "


def test_rows_are_multiples_of_the_unit() -> None:
    run = take_median([Run(0.3, 50.0, 7), Run(0.5, 50.0, 7), Run(0.4, 50.0, 7)])
    assert describe_run(run, 0.1) == ("0.40", "4.0", "50", "7", "")
