"""Policies in an environment and in C: the same walk, bit by bit."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.feedback.policy import Description, Policy
from tensegrity_codegen.learning.environment import environment
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tests.models import EXAMPLES

SCENE = EXAMPLES / "pinned_prism.toml"


def draw_policy(description: Description, hidden: int, activation: str) -> Policy:
    """Return a policy that moves the winches at random, and strongly."""
    draw, size, n = np.random.default_rng(0), description.n_observation, len(description.action)
    sizes = [size, hidden, n]
    return Policy(
        weights=tuple(draw.normal(size=(after, before)) for before, after in pairwise(sizes)),
        biases=tuple(0.1 * draw.normal(size=after) for after in sizes[1:]),
        activation=activation,
        mean=np.zeros(size),
        scale=np.where(np.arange(size) < size - n, 0.3, 0.05),
        description=description,
    )


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_a_walk_by_the_actions_of_the_c_is_that_of_the_policy(activation: str, tmp_path: Path) -> None:
    options = {"observe": ["member_length", "command"], "seconds": 100.0}
    in_python, in_c = (environment(SCENE, **options) for _ in range(2))  # type: ignore[arg-type]
    policy = draw_policy(in_python.description, 7, activation)
    model = compile_scene(SCENE, for_="equilibrium")
    controller = build_controller(model, policy=policy, out=tmp_path / "ctl").load()
    assert controller.init() == "ok"
    (first, _), (second, _) = in_python.reset(seed=1), in_c.reset(seed=1)
    start, most = first, 0.0
    for _ in range(100):
        first, *_ = in_python.step(policy(first))
        status, _ = controller.next(second[: -len(policy.description.action)])
        assert status in ("ok", "rate_limited", "range_limited")
        most = max(most, np.abs(controller.read("action") - policy(second)).max())
        second, *_ = in_c.step(controller.read("action"))
    assert np.abs(first - start).max() > 0.01
    assert most <= (0.0 if activation == "relu" else 1e-15)
    assert first == pytest.approx(second, abs=0.0 if activation == "relu" else 1e-9)
