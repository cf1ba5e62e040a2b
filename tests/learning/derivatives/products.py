"""Functions with derivatives: points, and products forward and backward against differences."""

from typing import Any

import numpy as np

from tensegrity_codegen.learning.derivatives.differentiable import Arrays, Differentiable
from tensegrity_codegen.system.arrays import FloatArray

Values = dict[str, FloatArray]
# Arguments of the triangle that no function takes, and what is said of them.
REFUSED: list[tuple[dict[str, Any], str]] = [
    *(
        ({name: value}, f"{name}: not an array of real numbers")
        for name, value in (
            ("rest_length", "0.5"),
            ("rest_length", ["0.5"]),
            ("rest_length", np.array(["0.5"], dtype=object)),
            ("rest_length", np.array([0.5 + 1.0j])),
            ("rest_length", [0.5 + 1.0j]),
            ("rest_length", {}),
            ("coordinate", [[1.0, 2.0], [1.0]]),
        )
    ),
    ({"coordinate": np.zeros(7)}, r"wrong shape(.|\n)*\(7,\)"),
    ({"coordinate": np.zeros((2, 6)), "velocity": np.zeros((3, 6))}, r"e \(2, 6\), velocity \(3, 6\)"),
]


def draw_points(function: Differentiable, lead: tuple[int, ...], shared: tuple[str, ...] = ()) -> Values:
    """Return values near the scene's, each with these leading axes but those that are shared."""
    draw, values = np.random.default_rng(0), {}
    for name, shape in function.inputs.items():
        nominal = function.model.nominal(name)
        size = (*(() if name in shared else lead), *shape)
        values[name] = nominal + 1e-3 * (np.abs(nominal) + (name != "internal")) * draw.normal(size=size)
    return values


def check_products(function: Differentiable, values: Arrays, rtol: float, step: float = 1e-6) -> None:
    """Assert that products forward are those of differences, and both ways each other's transpose."""
    draw = np.random.default_rng(1)
    ways = {name: draw.normal(size=value.shape) * (0.1 + np.abs(value)) for name, value in values.items()}
    forward = function.push(values, ways)
    ends = [
        function.evaluate({name: value + sign * step * ways[name] for name, value in values.items()})
        for sign in (1.0, -1.0)
    ]
    for name, along in forward.items():
        expected = (ends[0][name] - ends[1][name]) / (2 * step)
        size = np.abs(expected).max()
        assert size > 0.0, name
        np.testing.assert_allclose(along, expected, rtol=0.0, atol=rtol * size, err_msg=name)
    weights = {name: draw.normal(size=along.shape) for name, along in forward.items()}
    backward = function.pull(values, weights)
    name, along = next(iter(forward.items()))
    lead = along.shape[: along.ndim - len(function.outputs[name])]
    assert {name: array.shape for name, array in backward.items()} == {
        name: (*lead, *function.inputs[name]) for name in values
    }
    sides = [
        sum((weights[name] * forward[name]).sum() for name in weights),
        sum((backward[name] * ways[name]).sum() for name in values),
    ]
    size = sum(np.abs(weights[name] * forward[name]).sum() for name in weights)
    assert abs(sides[0] - sides[1]) <= 1e-2 * rtol * size
