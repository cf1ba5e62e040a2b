"""Policies: small networks that turn observations into commands of actuators, and what they observe."""

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import (
    UNREADABLE,
    check_finite,
    check_shape,
    read_arrays,
    to_doubles,
    write_arrays,
)
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.checks import check_instance, check_whole, is_number
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SceneError,
    SceneSyntaxError,
    check_choice,
    describe_reason,
)
from tensegrity_codegen.system.files import plain, write_text
from tensegrity_codegen.system.summaries import Summarised

COMMAND = "command"  # the observation of the commands of all actions that were sent last
ACTIVATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
}
OUTPUTS = ("linear", "tanh")
LARGEST = 1e30  # of what a network can compute: single precision holds it
MAX_DELAY = 1000  # samples
MAX_NAME = 200  # characters
MAX_NUMBERS = 100_000  # of an observation


def _check_label(value: Any, where: str) -> None:
    if not isinstance(value, str) or not value.isprintable() or not 0 < len(value) <= MAX_NAME:
        allowed = f"1 to {MAX_NAME} characters that can be printed"
        raise InvalidValueError("not a name", where=where, given=value, allowed=allowed)


def _check_range(value: Any, where: str, least: float = 1.0 / LARGEST, most: float = LARGEST) -> None:
    if not is_number(value) or not least <= value <= most:
        allowed = f"a number from {least:g} to {most:g}"
        raise InvalidValueError("out of range", where=where, given=value, allowed=allowed)


@contextmanager
def _reading(where: str, allowed: str) -> Iterator[None]:
    """Let all errors be SceneErrors that name a file first."""
    try:
        yield
    except SceneError as error:
        error.where = f"{where}: {error.where}"
        raise
    except (*UNREADABLE, RecursionError) as error:
        given = f"no {error}" if isinstance(error, KeyError) else describe_reason(error)
        raise SceneSyntaxError("cannot be read", where=where, given=given, allowed=allowed) from error


@dataclass(frozen=True)
class Observed:
    """A part of an observation.

    Attributes
    ----------
    name : str
        What is observed; ``"command"``: the commands of all actions as sent last.
    unit : str
        Unit of its numbers, ``"1"`` without one, ``"mixed"`` of commands of several units.
    size : int
        How many numbers it has.
    noise : float
        Standard deviation of the noise that it was trained with, in its unit.
    """

    name: str
    unit: str = "1"
    size: int = 1
    noise: float = 0.0

    def __post_init__(self) -> None:
        _check_label(self.name, "observation: name")
        _check_label(self.unit, f"observation {self.name}: unit")
        check_whole(self.size, f"observation {self.name}: size", 1, MAX_NUMBERS)
        _check_range(self.noise, f"observation {self.name}: noise", 0.0)


@dataclass(frozen=True)
class Acted:
    """An action from -1 to 1, which asks for the input ``centre + half_range * action`` of an actuator.

    Attributes
    ----------
    name : str
        Name of the actuator, or of an input, whose unit is then in the place of m.
    centre, half_range : float [m]
        Middle of the range of its input, and half of the width.
    rate : float [m/s]
        Largest rate of its input, infinite without a limit.
    delay : float [s]
        Time from the command to the motion.
    """

    name: str
    centre: float
    half_range: float
    rate: float = math.inf
    delay: float = 0.0

    def __post_init__(self) -> None:
        _check_label(self.name, "action: name")
        _check_range(self.centre, f"action {self.name}: centre", -LARGEST)
        _check_range(self.half_range, f"action {self.name}: half_range")
        stated: float | None = self.rate
        if stated is None:  # of JSON
            object.__setattr__(self, "rate", math.inf)
        elif stated != math.inf:
            _check_range(stated, f"action {self.name}: rate")


@dataclass(frozen=True)
class Description:
    """What a policy observes and moves, and how often.

    Attributes
    ----------
    scene : str
        Name of the scene.
    sample : float [s]
        Time between two actions.
    observation : tuple of Observed
        Parts of an observation, in their order.
    action : tuple of Acted
        Actions, in their order.
    randomised : tuple of str
        What was drawn anew for each episode, as stated.
    """

    scene: str
    sample: float
    observation: tuple[Observed, ...]
    action: tuple[Acted, ...]
    randomised: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_range(self.sample, "sample")
        check_instance(self.scene, str, "scene", "the name of a scene")
        for name, kind in (("observation", Observed), ("action", Acted), ("randomised", str)):
            parts: Any = getattr(self, name)
            check_instance(parts, (list, tuple), name, f"a tuple of {kind.__name__}")
            for part in parts:
                check_instance(part, kind, name, kind.__name__)
            object.__setattr__(self, name, tuple(parts))
        check_whole(self.n_observation, "observation: numbers", 0, MAX_NUMBERS)
        names = [acted.name for acted in self.action]
        if not names or not self.numbers or len(set(names)) < len(names):
            given = f"{len(self.numbers)} observed numbers, actions {', '.join(names) or 'none'}"
            allowed = "at least one number beside commands and one action, each action once"
            raise InvalidValueError("not a description", where="action", given=given, allowed=allowed)
        for acted in self.action:
            _check_range(acted.delay, f"action {acted.name}: delay", 0.0, MAX_DELAY * self.sample)
        for seen in self.observation:
            if seen.name == COMMAND:
                check_whole(seen.size, "observation command: size", len(names), len(names))

    @property
    def n_observation(self) -> int:
        """How many numbers an observation has, commands among them."""
        return sum(observed.size for observed in self.observation)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Name and unit of each number of an observation but the commands."""
        seen = [part for part in self.observation if part.name != COMMAND]
        rows = [(part, f"[{k}]" if part.size > 1 else "") for part in seen for k in range(part.size)]
        return tuple(f"{part.name}{place} in {part.unit}" for part, place in rows)

    @property
    def sources(self) -> IntArray:
        """Place of each number of an observation among `numbers`; of the command of action k -1 - k."""
        is_command = np.array([seen.name == COMMAND for seen in self.observation for _ in range(seen.size)])
        commands = -1 - (np.cumsum(is_command) - 1) % len(self.action)
        return np.where(is_command, commands, np.cumsum(~is_command) - 1)

    def to_json(self) -> str:
        """Return it as JSON text, in which a rate without limit is null."""
        return json.dumps(plain(asdict(self)), indent=1) + "\n"

    @classmethod
    def from_json(cls, text: str, where: str = "description") -> "Description":
        """Return the description that a text states; raises SceneError, which names `where` first."""
        with _reading(where, "JSON that `Description.to_json` wrote"):
            data = json.loads(text)
            data["observation"] = tuple(Observed(**row) for row in data["observation"])
            data["action"] = tuple(Acted(**row) for row in data["action"])
            return cls(**data)

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write it to a JSON file, whole or not at all."""
        write_text(self.to_json(), path, overwrite=overwrite)

    @classmethod
    def read(cls, path: str | Path) -> "Description":
        """Return the description of a JSON file; raises SceneError."""
        with _reading(str(path), "a JSON file"):
            return cls.from_json(Path(path).read_text(encoding="utf-8"))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Policy(Summarised):
    """A network of a few layers that turns observations into actions in -1..1.

    Attributes
    ----------
    weights : tuple of ndarray, shape (n_out, n_in)
        Of each layer.
    biases : tuple of ndarray, shape (n_out,)
        Of each layer.
    activation : str
        ``"tanh"``, ``"relu"`` or ``"elu"``, of all layers but the last.
    output : str
        ``"linear"`` or ``"tanh"``, of the last layer; its result is clipped to -1..1.
    mean, scale : ndarray, shape (n_observation,)
        The first layer takes ``(observation - mean) / scale``, clipped to -clip..clip.
    clip : float
        Its bound.
    description : Description
        What is observed and moved, and how often.
    """

    weights: tuple[FloatArray, ...]
    biases: tuple[FloatArray, ...]
    activation: str = "tanh"
    output: str = "linear"
    mean: FloatArray
    scale: FloatArray
    clip: float = 10.0
    description: Description

    def __post_init__(self) -> None:
        check_instance(self.description, Description, "description", "a Description")
        check_choice(self.activation, ACTIVATIONS, "activation", "activation")
        check_choice(self.output, OUTPUTS, "output", "output")
        _check_range(self.clip, "clip")
        for name in ("weights", "biases"):
            check_instance(getattr(self, name), (list, tuple), name, "a tuple of arrays, one for each layer")
            layers = [_freeze(value, f"{name}[{k}]") for k, value in enumerate(getattr(self, name))]
            object.__setattr__(self, name, tuple(layers))
        count = check_whole(len(self.weights), "weights: layers", 1)
        check_whole(len(self.biases), "biases: layers", count, count)
        # Sizes from the observation to the actions, and the largest sums that clipped observations can give.
        bound = np.full(size := self.description.n_observation, float(self.clip))
        for name in ("mean", "scale"):
            object.__setattr__(self, name, _freeze(getattr(self, name), name))
            check_shape(getattr(self, name), (size,), name)
        _check_range(float(self.scale.min()), "scale")
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            is_last = k + 1 == count
            n_out = len(self.description.action) if is_last else max((1, *weight.shape[:1]))
            check_shape(weight, (n_out, size), f"weights[{k}]")
            check_shape(bias, (n_out,), f"biases[{k}]")
            with np.errstate(over="ignore"):
                size, bound = n_out, np.maximum(np.abs(weight) @ bound + np.abs(bias), 1.0)
            _check_range(float(bound.max()), f"weights[{k}]: largest sum of products", 0.0)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of the observation and of the results of all layers."""
        return (self.description.n_observation, *(len(bias) for bias in self.biases))

    @property
    def summary(self) -> dict[str, Any]:
        """All but the numbers of the layers, JSON-ready."""
        named = {name: getattr(self, name) for name in ("sizes", "activation", "output", "clip")}
        return dict(plain(named | {"description": asdict(self.description)}))

    def __call__(self, observation: ArrayLike) -> FloatArray:
        """Return the actions (n, n_actions) or (n_actions,) for (n, n_observation) or (n_observation,).

        They have the bits of the policy in C, but for what `tanh` and `exp` differ by in the last place.
        """
        values = to_doubles(observation, "observation", "numbers")
        check_shape(values, (*values.shape[:-1][-1:], self.sizes[0]), "observation")
        values = np.clip((values - self.mean) / self.scale, -self.clip, self.clip)
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            products = weight * values[..., None, :]
            terms = np.concatenate([np.broadcast_to(bias, products.shape[:-1])[..., None], products], axis=-1)
            values = np.cumsum(terms, axis=-1)[..., -1]  # in the order of the sums in C
            if k + 1 < len(self.weights):
                values = ACTIVATIONS[self.activation](values)
        return np.clip(np.tanh(values) if self.output == "tanh" else values, -1.0, 1.0)

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write it to an ``.npz`` file, whole or not at all, which `read_policy` reads."""
        arrays = {f"weights[{k}]": weight for k, weight in enumerate(self.weights)}
        arrays |= {f"biases[{k}]": bias for k, bias in enumerate(self.biases)}
        single = ("activation", "output", "mean", "scale", "clip")
        arrays |= {name: np.array(getattr(self, name)) for name in single}
        arrays["description"] = np.array(self.description.to_json())
        write_arrays(path, arrays, overwrite=overwrite)


def _freeze(value: Any, where: str) -> FloatArray:
    """Return a read-only copy of an array of finite numbers."""
    array = np.array(to_doubles(value, where, "an array of numbers"))
    check_finite(array, where)
    array.flags.writeable = False
    return array


def read_policy(path: str | Path) -> Policy:
    """Read a policy that `Policy.write` wrote.

    Parameters
    ----------
    path : str or Path
        An ``.npz`` file.

    Returns
    -------
    Policy
        All of it is checked, and no Python object is read from the file.

    Raises
    ------
    SceneError
        The file is none of a policy; the message names the file and the array.

    Examples
    --------
    >>> import numpy as np
    >>> from tensegrity_codegen import Acted, Description, Observed, Policy, read_policy
    >>> seen = (Observed("winch.length", "m"), Observed("command", "m"))
    >>> description = Description("lift", 0.02, seen, (Acted("winch", 0.0, 0.1, rate=0.5),))
    >>> policy = Policy(
    ...     weights=(np.array([[2.0, 0.5]]),), biases=(np.zeros(1),), mean=np.array([1.0, 0.0]),
    ...     scale=np.ones(2), description=description,
    ... )
    >>> policy.write("lift.npz")
    >>> read_policy("lift.npz")([1.1, 0.0]).round(3)
    array([0.2])
    """
    with _reading(str(path), "an .npz file that Policy.write wrote"):
        data = read_arrays(Path(path))
        layers = range(sum(name.startswith("weights[") for name in data) or 1)
        return Policy(
            weights=tuple(data[f"weights[{k}]"] for k in layers), mean=data["mean"], scale=data["scale"],
            biases=tuple(data[f"biases[{k}]"] for k in layers), activation=str(data["activation"]),
            output=str(data["output"]), clip=data["clip"].item(),
            description=Description.from_json(str(data["description"])),
        )  # fmt: skip
