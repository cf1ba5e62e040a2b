"""The linear model about a state: matrices, natural frequencies, damping ratios."""

import itertools
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.linear.spectrum import Spectrum, find_spectrum
from tensegrity_codegen.runtime.linear.write_linear import write_linear_model
from tensegrity_codegen.runtime.model.arguments import check_arguments, merge_inputs
from tensegrity_codegen.runtime.model.arrays import check_finite, check_shape, to_doubles
from tensegrity_codegen.runtime.model.interface import (
    Model,
    name_states,
    require_double,
    require_model,
    require_quantities,
)
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.model.rigid_bars import RigidBars
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.memory import is_constant
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, name_list
from tensegrity_codegen.system.summaries import Fact, Summarised, count_names, describe_number, describe_range
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import Manifest

KINK_QUANTITIES = ("member_length", "member_extension")
# What a model in redundant coordinates is asked for: its columns span the variations that can happen.
SPANNING_QUANTITY = "distance_inertia_inverse"
RANK_TOLERANCE = 1e-10  # of the largest eigenvalue
# What a linear model needs of every model, and of one with inputs too.
LINEARIZE_QUANTITIES = ("state_derivative", "state_jacobian")
INPUT_QUANTITY = "input_jacobian"
ROUNDING = 64 * sys.float_info.epsilon  # of lengths, over lengths and coordinates
SETTLED_ROUNDING = 1e-11  # the same, of lengths that an equilibrium gives
# Acceleration, over extent and square of the lowest angular frequency, that counts as none.
BALANCE_TOLERANCE = 1e-4


def find_kinks(
    model: Model, coordinate: FloatArray, rounding: float, arguments: Mapping[str, Any]
) -> dict[str, bool]:
    """Return the cables at their rest lengths within relative rounding, with whether each counts as taut."""
    structure = getattr(model, "structure", None)
    if structure is None or structure.is_bar.all() or not all(model.has(name) for name in KINK_QUANTITIES):
        return {}
    values = {**arguments, "coordinate": coordinate}
    length = np.asarray(model.compute("member_length", **values))
    extension = np.asarray(model.compute("member_extension", **values))
    scale = np.maximum(np.maximum(length, length - extension), np.abs(coordinate).max(initial=0.0))
    at_rest = ~np.asarray(structure.is_bar) & (np.abs(extension) <= rounding * scale)
    return {model.manifest.member_name[row]: bool(extension[row] > 0.0) for row in np.flatnonzero(at_rest)}


def describe_kinks(kinks: Mapping[str, bool]) -> list[str]:
    """Return the warning about cables at their rest lengths, none without any."""
    sides = [
        f"as {side}: {name_list(names, 10)}"
        for side, is_taut in (("taut", True), ("slack", False))
        if (names := [name for name, taut in kinks.items() if taut is is_taut])
    ]
    if not sides:
        return []
    return [
        f"{len(kinks)} cable{'s are' if len(kinks) > 1 else ' is'} exactly at rest length, where the "
        f"stiffness jumps; the linear model holds on one side only. It treats {'; '.join(sides)}"
    ]


# Which variations of a state the constraints between its coordinates allow.


@dataclass(frozen=True)
class Variations:
    """T = [Z 0; W Z] (n_states, n_variations) with Z^T Z = 1, Z^T W = 0: variations T p that can happen.

    T moves with the state. With Z' = W (the frame that turns least) and L = [Z^T 0; 0 Z^T], L T = 1, the
    linear model of p is p' = (L A T - L T') p, L T' = [0 0; -W^T W 0]. Internal states vary freely: T and L
    have an identity for them below.

    Attributes
    ----------
    along, turning : sparse arrays, shape (n_coordinates, n_directions)
        Z and W.
    n_internal : int
        Number of internal states.
    """

    along: Any
    turning: Any
    n_internal: int = 0

    @property
    def basis(self) -> Any:
        """Return T, sparse."""
        empty = scipy.sparse.csc_array(self.along.shape)
        moving = scipy.sparse.block_array([[self.along, empty], [self.turning, self.along]])
        return scipy.sparse.csc_array(scipy.sparse.block_diag([moving, self._free]))

    @property
    def projection(self) -> FloatArray:
        """Return T L, dense (n_states, n_states), which leaves variations that can happen as they are."""
        left = scipy.sparse.block_diag([self.along, self.along, self._free]).T
        return np.asarray((self.basis @ left).toarray())

    def reduce(self, state_matrix: Any) -> Any:
        """Return L A T - L T', sparse (n_variations, n_variations), of A (n_states, n_states)."""
        projection = scipy.sparse.csc_array(scipy.sparse.block_diag([self.along, self.along, self._free])).T
        empty = scipy.sparse.csc_array((self.along.shape[1],) * 2)
        turned = scipy.sparse.block_array([[empty, empty], [self.turning.T @ self.turning, empty]])
        frame = scipy.sparse.block_diag([turned, 0.0 * self._free])
        return scipy.sparse.csc_array(projection @ state_matrix @ self.basis + frame)

    @property
    def _free(self) -> Any:
        return scipy.sparse.eye_array(self.n_internal, format="csc")


def find_variations(model: Model, at: Mapping[str, Any]) -> Variations | None:
    """Return the variations of a state x = (q, q') that can happen, None if all can.

    Parameters
    ----------
    model : Model
        The model.
    at : mapping
        All its arguments, with coordinate and velocity.

    Returns
    -------
    Variations or None
        Of rigid bars those with d_b . d(dq) = 0 and d_b . d(dq') + d_b' . d(dq) = 0, where d(.) is the
        difference of both ends.
    """
    if model.manifest.rigid_bar:
        return _along_bars(model, at)
    if model.has(SPANNING_QUANTITY):
        size, direction = np.linalg.eigh(model.compute(SPANNING_QUANTITY, **at).toarray())
        along = scipy.sparse.csc_array(direction[:, size > RANK_TOLERANCE * size.max()])
        return Variations(along, scipy.sparse.csc_array(along.shape))
    return None


def _along_bars(model: Model, at: Mapping[str, Any]) -> Variations:
    """Return the variations that rigid bars of constant lengths allow."""
    bars = RigidBars(model.manifest, np.zeros(len(model.manifest.rigid_bar)))
    n_internal = _count_internal(model.manifest)
    position = place_nodes(model, at["coordinate"], at.get("anchor_position"))
    along = bars.find_directions(bars.jacobian(position))
    if not np.any(at["velocity"]):
        return Variations(along, scipy.sparse.csc_array(along.shape), n_internal)
    rate = bars.rows(bars.vectors(place_velocities(model, at["coordinate"], at["velocity"])))
    rows = bars.rows(bars.vectors(position)).toarray()
    turning = np.linalg.lstsq(rows, -(rate @ along).toarray(), rcond=None)[0]
    return Variations(along, scipy.sparse.csc_array(turning), n_internal)


@dataclass(frozen=True, repr=False)
class LinearModel(Summarised):
    """Linear model x' = A (x - state) + B (u - input) + residual_rate, exact to first order, x = (q, q', z).

    Attributes
    ----------
    A, B : sparse arrays, shape (n_states, n_states) and (n_states, n_inputs)
        Jacobians of the state derivative.
    c : ndarray, shape (n_states,)
        Constant of the same model as x' = A x + B u + c; large where positions are.
    residual_rate : ndarray, shape (n_states,)
        State derivative at (state, input); zero at an equilibrium up to its tolerance.
    state, input : ndarray, shape (n_states,) and (n_inputs,)
        The operating point.
    state_name, input_name : tuple of str
        Names of states and inputs.
    spectrum : Spectrum
        Eigenvalues, natural frequencies and damping ratios.
    variation : sparse array, shape (n_states, n_variations), or None
        T, where coordinates depend on each other (rigid bars, node distances): x = state + T p are the
        possible variations, and the spectrum is that of the linear model of p. None if all variations are
        possible.
    one_sided_cables : dict of str to bool
        Cables exactly at rest length, where the stiffness jumps, with whether they count as taut.
    slipping_feet : tuple of str
        Feet of the equilibrium at the limit of friction, where it jumps too.
    """

    A: Any
    B: Any
    c: FloatArray
    residual_rate: FloatArray
    state: FloatArray
    input: FloatArray
    state_name: tuple[str, ...]
    input_name: tuple[str, ...]
    spectrum: Spectrum
    variation: Any = None
    one_sided_cables: Mapping[str, bool] = field(default_factory=dict)
    slipping_feet: tuple[str, ...] = ()

    def headline(self) -> str:
        """Return the numbers of states and inputs."""
        return f"{len(self.state)} states, {len(self.input)} inputs"

    def facts(self) -> list[Fact]:
        """Return names, frequencies and damping, for `repr` and notebooks."""
        largest = float(np.max(np.abs(self.residual_rate), initial=0.0))
        return [
            ("states", count_names(self.state_name)),
            ("inputs", count_names(self.input_name)),
            ("natural frequencies", describe_range(self.natural_frequency, "Hz")),
            ("damping ratios", describe_range(self.damping_ratio)),
            ("non-zeros", f"A {self.A.nnz}, B {self.B.nnz}"),
            ("largest residual rate", describe_number(largest)),
        ]

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the linear model to a file, whole or not at all.

        Parameters
        ----------
        path : str or Path
            ``.npz``: matrices as rows, columns and values (``A_row``, ``A_column``, ``A_value``,
            ``A_shape``), vectors, names. ``.mat``: sparse matrices, vectors, names as cells. ``.csv``: the
            columns matrix, row, column, value; a line for each non-zero entry, with names of states and
            inputs. A name without ending is an ``.npz`` file.
        overwrite : bool
            Whether a file that exists is replaced.

        Raises
        ------
        OutputError
            The file cannot be written, exists already, or has another ending.
        """
        write_linear_model(self, path, overwrite=overwrite)

    @property
    def natural_frequency(self) -> FloatArray:
        """Undamped natural frequencies `|lambda| / 2 pi` of the oscillating modes [Hz]."""
        return self.spectrum.natural_frequency

    @property
    def damping_ratio(self) -> FloatArray:
        """Damping ratios `-Re lambda / |lambda|` of the oscillating modes."""
        return self.spectrum.damping_ratio

    @property
    def is_balanced(self) -> bool:
        """Whether forces are in balance at `state`, so that modes are vibrations about an equilibrium."""
        half = len(self._speed)
        position = self.state[:half]
        extent = float(np.ptp(position)) if half else 0.0
        slowest = float(self.natural_frequency.min(initial=math.inf))
        square = (2 * math.pi * slowest) ** 2 if math.isfinite(slowest) else float(abs(self.A).max())
        return bool(self._fall <= BALANCE_TOLERANCE * square * (extent or 1.0))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about the limits of the linear model."""
        sentences = []
        if self.slipping_feet:
            sentences.append(
                f"feet at the limit of friction: {', '.join(self.slipping_feet)}; their stiffness jumps "
                "there, and the linear model holds on one side only"
            )
        speed = float(abs(self._speed).max(initial=0.0))
        if speed > 0:
            sentences.append(
                f"the structure moves at x0 (largest velocity {speed:.3g}): eigenvalues hold for this moment "
                "only"
            )
        if not self.is_balanced:
            sentences.append(
                f"the structure is out of balance at x0 (largest acceleration {self._fall:.3g}): eigenvalues "
                "and frequencies are not those of vibrations about an equilibrium, and rigid motions may "
                "appear as vibrations; linearize about the equilibrium to avoid that"
            )
        return (*sentences, *describe_kinks(self.one_sided_cables))

    @property
    def _speed(self) -> FloatArray:
        """Rates of the coordinates, which internal states stand behind."""
        half = sum(name.endswith("'") for name in self.state_name)
        return self.state[half : 2 * half]

    @property
    def _fall(self) -> float:
        """Largest acceleration of a coordinate."""
        half = len(self._speed)
        return float(abs(self.residual_rate[half : 2 * half]).max(initial=0.0))

    def as_evidence(self) -> dict[str, Any]:
        """Return sizes, spectrum and doubts by name, JSON-ready but for arrays."""
        return {
            "n_states": len(self.state),
            "n_inputs": len(self.input_name),
            "n_variations": len(self.state) if self.variation is None else self.variation.shape[1],
            "A_nonzeros": self.A.nnz,
            "B_nonzeros": self.B.nnz,
            "largest_affine_term": float(abs(self.c).max()),
            "largest_residual_rate": float(abs(self.residual_rate).max()),
            "residual_rate": self.residual_rate,
            "natural_frequency": self.natural_frequency,
            "damping_ratio": self.damping_ratio,
            "zero_eigenvalues": self.spectrum.zero_eigenvalues,
            "growing_eigenvalues": self.spectrum.growing,
            "is_balanced": self.is_balanced,
            "one_sided_cables": list(self.one_sided_cables),
            "state_name": self.state_name,
            "input_name": self.input_name,
            "inputs": dict(zip(self.input_name, self.input.tolist(), strict=True)),
        }


def linearize(
    model: Model,
    equilibrium: Equilibrium | ArrayLike | None = None,
    *,
    coordinate: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    input: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    frequency_count: int = 20,
) -> LinearModel:
    """Compute the linear model about a state.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"linearize"``, see compile_scene.
    equilibrium : Equilibrium or array_like, shape (n_coordinates,), optional
        The equilibrium or its coordinates [m], in place of `coordinate`; at rest unless `velocity` is given.
        Its inputs and parameters are to be given again, bristles of its feet on the ground are not.
    coordinate, velocity : array_like, shape (n_coordinates,), optional
        State [m, m/s]; by default that of the scene.
    input : array_like, shape (n_inputs,), optional
        Inputs [m or N]; by default zero.
    arguments : mapping, optional
        Parameters and inputs by name, where they differ from the scene; of contacts with friction also
        ``internal``, shape (n_internal,), by default that of the scene: zero, and viscous members relaxed.
    frequency_count : int
        Number of eigenvalues of smallest modulus that are computed above 1,500 states; below, all are.

    Returns
    -------
    LinearModel
        Matrices, operating point and spectrum.

    Raises
    ------
    FormulationError
        The model lacks a quantity.
    InvalidValueError
        A wrong shape, or coordinates or inputs given twice.
    NonFiniteError
        The derivatives at the state are not finite.

    Notes
    -----
    A = dx'/dx, B = dx'/du (docs/derivatives.md, S&K 5).

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, linearize
    >>> model = compile_scene("two_nodes.toml", for_="linearize")
    >>> linear = linearize(model, coordinate=[0.0, 0.0, -1.0613125])
    >>> linear.A.shape, round(float(linear.natural_frequency[-1]), 4)  # sqrt(80 N/m / 0.5 kg) / (2 pi)
    ((6, 6), 2.0132)
    """
    require_model(model)
    check_whole(frequency_count, "frequency_count", 1)
    require_double(model.manifest, "linearization")
    if equilibrium is not None:
        if coordinate is not None:
            raise InvalidValueError(
                "the coordinates are given twice",
                where="coordinate",
                allowed="an equilibrium, or coordinates",
            )
        coordinate = equilibrium.coordinate if isinstance(equilibrium, Equilibrium) else equilibrium
        velocity = 0 * model.nominal("velocity") if velocity is None else velocity
    _check_lengths(model.manifest)
    inputs = model.manifest.input_name
    require_quantities(model, _needed(bool(inputs)), "a linear model needs")
    q = _value(model, "coordinate", coordinate)
    v = _value(model, "velocity", velocity)
    parameters = merge_inputs(model.manifest, arguments)
    check_arguments(model.manifest, parameters)
    if isinstance(equilibrium, Equilibrium):
        parameters = {**equilibrium.internal_argument, **parameters}
    u = _value(model, "input", _choose_input(input, parameters)) if inputs else np.zeros(0)
    at = {**parameters, "coordinate": q, "velocity": v}
    if inputs:
        at["input"] = u
    internal = [_value(model, "internal", parameters.get("internal"))] if model.manifest.internal_name else []
    # Energies that a balance adds up, and what members remember, would be eigenvalues of zero.
    states = name_states(model.manifest)
    varies = np.array([not is_constant(name) for name in states])
    state = np.concatenate([q, v, *internal])[varies]
    a, b = model.compute("state_jacobian", **at), scipy.sparse.csc_array((len(states), 0))
    if inputs:
        b = model.compute(INPUT_QUANTITY, **at)
    if not varies.all():
        a, b = a[varies][:, varies], b[varies]
    rate = np.asarray(model.compute("state_derivative", **at))[varies]
    # Variations that cannot happen never move, and would come out as zeros to half the digits.
    allowed = find_variations(model, {**at, "coordinate": q, "velocity": v})
    reduced = a if allowed is None else allowed.reduce(a)
    spectrum = find_spectrum(reduced, frequency_count, _count_internal(model.manifest))
    names = tuple(itertools.compress(states, varies))
    basis = None if allowed is None else allowed.basis
    feet = equilibrium.feet if isinstance(equilibrium, Equilibrium) else None
    return LinearModel(
        a, b, rate - a @ state - b @ u, rate, state, u, names, inputs, spectrum, basis,
        one_sided_cables=find_kinks(model, q, ROUNDING if equilibrium is None else SETTLED_ROUNDING, at),
        slipping_feet=() if feet is None else feet.slipping,
    )  # fmt: skip


def linearize_quantities(formulation: str, *, with_inputs: bool) -> tuple[str, ...]:
    """Return the quantities that linearize needs in a formulation."""
    return (*_needed(with_inputs), *find_formulation(formulation).linear_quantities)


def _count_internal(manifest: Manifest) -> int:
    """Return the number of internal states of a linear model."""
    return sum(not is_constant(name) for name in manifest.internal_name)


def _needed(with_inputs: bool) -> tuple[str, ...]:
    return (*LINEARIZE_QUANTITIES, INPUT_QUANTITY) if with_inputs else LINEARIZE_QUANTITIES


def _choose_input(input: ArrayLike | None, arguments: Mapping[str, Any]) -> ArrayLike | None:
    """Return the inputs, given as such or among the arguments; raises InvalidValueError for both."""
    if input is not None and "input" in arguments:
        raise InvalidValueError(
            "the inputs are given twice", where="input", allowed="input=, or inputs among arguments="
        )
    return arguments.get("input") if input is None else input


def _value(model: Model, name: str, given: ArrayLike | None) -> FloatArray:
    nominal = model.nominal(name).ravel()
    if given is None:
        return nominal
    value = np.array(to_doubles(given, name, f"shape {nominal.shape}"))
    check_shape(value, nominal.shape, name)
    check_finite(value, name)
    return value


def _check_lengths(manifest: Manifest) -> None:
    if find_formulation(manifest.formulation).has_rigid_bars and not manifest.rigid_bar:
        raise FormulationError(
            "bars with first-order correction have no linear model",
            where=manifest.name,
            given='options.correction = "first_order"',
            allowed='correction = "none", or formulation = "node_position"',
            hint="in node positions these bars are springs, which is exact and not slower",
        )
