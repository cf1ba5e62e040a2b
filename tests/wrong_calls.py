"""Values that are wrong for most arguments, and what calls with them raise."""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from tensegrity_codegen.system.errors import TensegrityError

WRONG: tuple[Any, ...] = (
    *(
        None,
        True,
        0,
        -1,
        3,
        2.5,
        math.nan,
        -math.inf,
        1e300,
        10**400,
        1 + 2j,
        "",
        "x",
        "\0",
        "a\0b",
        "\ud800",
    ),
    *(b"x", [], [None], ["x"], [[1, 2], [3]], (1, "a"), {}, {"x": 1}, {1: 2}, {1}, set(), object()),
    *({"motor": 1j}, {"motor": [[1.0]]}, {"motor": None}, {"rest_length": "x"}, {"node_load": [1, 2]}),
    *(np.zeros(0), np.zeros((6, 3)), np.zeros((2, 3, 4)), np.full((6, 3), np.nan), np.ones((6, 3), complex)),
    *(np.array("x"), np.array([None]), np.array(object()), np.bool_(True), np.datetime64("2020")),
    *(np.timedelta64(1, "s"), range(3), ..., slice(1), memoryview(b"ab")),
)


def list_bare_errors(
    function: Callable[..., Any], right: dict[str, Any], names: Iterable[str], values: Iterable[Any] = WRONG
) -> list[str]:
    """Call a function with each value in place of each of these arguments; list errors not of the package."""
    bare = []
    for name, value in ((name, value) for name in names for value in values):
        try:
            function(**(right | {name: value}))
        except TensegrityError:
            continue
        except Exception as error:
            bare.append(f"{name}={value!r:.40}: {type(error).__name__}: {error}")
    return bare
