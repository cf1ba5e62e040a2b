"""Arguments that have moved into an object: calls that still name them are told which one."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from tensegrity_codegen.system.errors import TensegrityError

P = ParamSpec("P")
R = TypeVar("R")


class MovedArgumentError(TensegrityError, TypeError):
    """A keyword that a function had, and that an object given to it has now."""


def with_moved(**places: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for a function that had these arguments.

    places: name of an argument -> how it is stated now, such as ``"until=Until(condition=...)"``.
    The function raises MovedArgumentError for a call with one of the names.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            for name in kwargs:
                if name in places:
                    problem = f"{function.__name__} takes this argument in an object"
                    raise MovedArgumentError(problem, where=name, given=f"{name}=...", allowed=places[name])
            return function(*args, **kwargs)

        return call

    return decorate
