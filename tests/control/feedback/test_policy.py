"""Policies: their numbers by hand, files that are read without trust, descriptions as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.policy import Acted, Description, Observed, Policy, read_policy
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    UnknownNameError,
)

SEEN = (Observed("length of top1", "m", 2, 1e-3), Observed("command", "m", 2))
ACTIONS = (Acted("winch", 0.01, 0.05, rate=0.5, delay=0.03), Acted("other", 0.0, 0.1))
DESCRIPTION = Description("prism", 0.02, SEEN, ACTIONS, ("friction=uniform(0.3,0.8)",))


def build(**changes: Any) -> Policy:
    """Return a policy of two layers, with changes."""
    random = np.random.default_rng(1)
    fields: dict[str, Any] = {
        "weights": (random.normal(size=(3, 4)), random.normal(size=(2, 3))),
        "biases": (random.normal(size=3), random.normal(size=2)),
        "activation": "tanh",
        "mean": np.array([1.0, 1.0, 0.0, 0.0]),
        "scale": np.array([0.1, 0.2, 0.05, 0.1]),
        "clip": 2.0,
        "description": DESCRIPTION,
    }
    return Policy(**(fields | changes))


ELEMENTWISE = {
    "tanh": lambda x: float(np.tanh(x)),
    "relu": lambda x: max(x, 0.0),
    "elu": lambda x: x if x > 0 else float(np.exp(x)) - 1.0,
}


@pytest.mark.parametrize("activation", ["tanh", "relu", "elu"])
@pytest.mark.parametrize("output", ["linear", "tanh"])
def test_actions_are_those_of_sums_by_hand(activation: str, output: str) -> None:
    """Normalised, clipped, two layers, clipped again; rows one by one and together."""
    policy = build(activation=activation, output=output)
    observations = np.random.default_rng(2).normal(1.0, 0.5, size=(5, 4))
    expected = []
    for row in observations:
        values = [min(max((row[i] - policy.mean[i]) / policy.scale[i], -2.0), 2.0) for i in range(4)]
        hidden = [
            ELEMENTWISE[activation](
                sum(policy.weights[0][j, i] * values[i] for i in range(4)) + policy.biases[0][j]
            )
            for j in range(3)
        ]
        last = [
            sum(policy.weights[1][u, j] * hidden[j] for j in range(3)) + policy.biases[1][u] for u in range(2)
        ]
        last = [float(np.tanh(x)) for x in last] if output == "tanh" else last
        expected.append([min(max(x, -1.0), 1.0) for x in last])
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(policy(observations[3]), expected[3], rtol=0, atol=1e-14)
    assert policy.sizes == (4, 3, 2)


def test_files_have_all_of_a_policy(tmp_path: Path) -> None:
    """What is written is read bit by bit, infinite rates among it."""
    policy = build(activation="elu", output="tanh")
    policy.write(tmp_path / "policy.npz")
    read = read_policy(tmp_path / "policy.npz")
    assert read.description == DESCRIPTION
    assert (read.activation, read.output, read.clip) == ("elu", "tanh", 2.0)
    for name in ("weights", "biases"):
        for one, other in zip(getattr(policy, name), getattr(read, name), strict=True):
            np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(policy([1.0, 1.1, 0.0, 0.1]), read([1.0, 1.1, 0.0, 0.1]))


def test_descriptions_are_json(tmp_path: Path) -> None:
    """A rate without limit is null in it; a file has the same."""
    data = json.loads(DESCRIPTION.to_json())
    assert [row["rate"] for row in data["action"]] == [0.5, None]
    DESCRIPTION.write(tmp_path / "seen.json")
    assert Description.read(tmp_path / "seen.json") == DESCRIPTION
    assert DESCRIPTION.n_observation == 4


@pytest.mark.parametrize(
    ("changes", "error", "where"),
    [
        ({"activation": "tanhh"}, UnknownNameError, "activation"),
        ({"output": "relu"}, UnknownNameError, "output"),
        ({"mean": np.zeros(3)}, InvalidValueError, "mean"),
        ({"scale": np.array([1.0, 0.0, 1.0, 1.0])}, InvalidValueError, "scale"),
        ({"scale": np.array([1.0, np.nan, 1.0, 1.0])}, NonFiniteError, "scale"),
        ({"clip": 0.0}, InvalidValueError, "clip"),
        ({"weights": (), "biases": ()}, InvalidValueError, "weights: layers"),
        (
            {"weights": (np.zeros((0, 4)), np.zeros((2, 0))), "biases": (np.zeros(0), np.zeros(2))},
            InvalidValueError,
            "weights[0]",
        ),
        ({"weights": (np.array(1.0), np.zeros((2, 3)))}, InvalidValueError, "weights[0]"),
        ({"biases": (np.zeros(3),)}, InvalidValueError, "biases: layers"),
        ({"weights": (np.zeros((3, 5)), np.zeros((2, 3)))}, InvalidValueError, "weights[0]"),
        ({"weights": (np.zeros((3, 4)), np.zeros((3, 3)))}, InvalidValueError, "weights[1]"),
        ({"weights": (np.zeros(4), np.zeros((2, 3)))}, InvalidValueError, "weights[0]"),
        ({"weights": (np.full((3, 4), np.inf), np.zeros((2, 3)))}, NonFiniteError, "weights[0]"),
        (
            {"weights": (np.full((3, 4), 1e300),) * 2},
            InvalidValueError,
            "weights[0]: largest sum of products",
        ),
        ({"biases": (np.zeros(3), np.array(["a", "b"]))}, InvalidValueError, "biases[1]"),
        ({"description": {"scene": "prism"}}, InvalidValueError, "description"),
    ],
)
def test_wrong_networks_are_refused(changes: dict[str, Any], error: type[Exception], where: str) -> None:
    """The error names the array."""
    with pytest.raises(error) as refused:
        build(**changes)
    assert refused.value.where == where  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Observed("", "m"),
        lambda: Observed("two\nlines", "m"),
        lambda: Observed("x", "m" * 300),
        lambda: Observed("x", "m", 0),
        lambda: Observed("x", "m", 100_001),
        lambda: Description("prism", 0.02, (Observed("x", "m", 60_000),) * 2, ACTIONS),
        lambda: Observed("x", "m", 1, -1.0),
        lambda: Acted("winch", 0.0, 0.0),
        lambda: Acted("winch", np.nan, 1.0),
        lambda: Acted("winch", 0.0, 1.0, rate=0.0),
        lambda: Description("prism", 0.02, SEEN[:1], (Acted("winch", 0.0, 1.0, delay=-1.0),)),
        lambda: Description("prism", 0.0, SEEN, ACTIONS),
        lambda: Description("prism", 0.02, SEEN, ()),
        lambda: Description("prism", 0.02, SEEN[1:], ACTIONS),
        lambda: Description("prism", 0.02, SEEN, (ACTIONS[0], ACTIONS[0])),
        lambda: Description("prism", 0.02, SEEN, ACTIONS[:1]),
        lambda: Description("prism", 1e-6, SEEN, ACTIONS),
    ],
)
def test_wrong_descriptions_are_refused(make: Any) -> None:
    """Names, sizes, ranges, no action, one twice, commands of others, long delays."""
    with pytest.raises(InvalidValueError):
        make()


def test_sizes_that_would_fill_the_memory_are_refused_before_they_are_listed() -> None:
    """Of a part in JSON, and of a hundred thousand parts."""
    huge = DESCRIPTION.to_json().replace('"size": 2', f'"size": {10**10}', 1)
    many = (Observed("x", "m", 100_000),) * 100_000
    for make, where in (
        (lambda: Description.from_json(huge, "file"), "file: observation length of top1: size"),
        (lambda: Description("prism", 0.02, many, ACTIONS), "observation: numbers"),
    ):
        with pytest.raises(InvalidValueError, match="100000") as refused:
            make()
        assert refused.value.where == where


def test_tensors_that_require_gradients_are_refused_with_what_to_write() -> None:
    """As PyTorch raises it."""

    class Tensor:
        def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
            raise RuntimeError("Use tensor.detach().numpy() instead.")

    with pytest.raises(InvalidValueError) as refused:
        build(weights=(Tensor(), np.zeros((2, 3))))
    assert refused.value.where == "weights[0]"
    assert "detach" in refused.value.hint


def test_networks_without_layers_are_refused_with_what_is_allowed() -> None:
    with pytest.raises(InvalidValueError) as refused:
        build(weights=(), biases=())
    assert refused.value.allowed == "a whole number from 1 on"


def test_wrong_files_are_named_with_their_array(tmp_path: Path) -> None:
    """No file, another one, arrays that are missing, pickled, of words; a description that is damaged."""
    path = tmp_path / "policy.npz"
    build().write(path)
    with np.load(path) as archive:
        arrays = dict(archive)

    def refuse(**changes: Any) -> SceneError:
        changed = {name: value for name, value in (arrays | changes).items() if value is not None}
        np.savez(path, **changed)
        with pytest.raises(SceneError) as refused:
            read_policy(path)
        assert refused.value.where.startswith(str(path))
        return refused.value

    assert "biases[1]" in str(refuse(**{"biases[1]": None}))
    assert "weights[0]" in str(refuse(**{"weights[0]": np.full((3, 4), "a")}))
    assert "weights[0]" in str(refuse(**{"weights[0]": np.full((3, 4), np.nan)}))
    assert isinstance(refuse(scale=np.array([print] * 4, dtype=object)), SceneSyntaxError)
    assert "clip" in str(refuse(clip=np.array("wide")))
    assert "activation" in str(refuse(activation=np.array("sine")))
    text = DESCRIPTION.to_json()
    assert "description" in str(refuse(description=np.array("{")))
    assert "'random'" in str(refuse(description=np.array(text.replace("randomised", "random"))))
    assert "'late'" in str(refuse(description=np.array(text.replace('"delay"', '"late"'))))
    assert "half_range" in str(
        refuse(description=np.array(text.replace('"half_range": 0.1', '"half_range": -1')))
    )
    path.write_bytes(b"no archive")
    with pytest.raises(SceneSyntaxError, match=r"not an \.npz archive") as refused:
        read_policy(path)
    assert refused.value.where == str(path)
    with pytest.raises(SceneSyntaxError):
        read_policy(tmp_path / "none.npz")
    with pytest.raises(InvalidValueError, match="shape"):
        build()([1.0, 2.0])
