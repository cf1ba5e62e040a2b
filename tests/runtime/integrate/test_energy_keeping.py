"""Steps that end at the energy of the start: momentum, bars, events; what is refused."""

import functools
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, UnknownNameError
from tests.cases import thorough
from tests.models import simulator
from tests.runtime.build import cable, make_structure, prism
from tests.runtime.stiff_bars import class_two, pendulums

SPAN = 20.0


def flying(mass: float = 0.0) -> Structure:
    """A prism off its equilibrium that flies and tumbles, far from the origin, with cables that go slack."""
    structure = prism(140.0, bar_stiffness=5e3, strain=0.005)
    place = structure.node_position + np.array([3.0, -2.0, 5.0])
    velocity = np.cross([0.4, 0.3, 1.0], structure.node_position) + np.array([0.3, -0.2, 0.1])
    heavy = np.where(structure.is_bar, mass, 0.0)
    return structure.with_changes(node_position=place, node_velocity=velocity, member_mass=heavy)


@functools.cache
def model_of(name: str) -> CompiledModel:
    formulation = "rigid_bar" if name == "rigid" else "node_position"
    structures = {
        "free": flying(),
        "heavy": flying(0.4),
        "rigid": flying(0.4),
        "hung": class_two(20.0),
        "plane": make_structure(
            [[0, 0, 0], [1, 0, 0], [0.4, 0, 0.9]],
            [cable(0, 1, 0.9), cable(1, 2, 0.8), cable(2, 0, 0.7)],
            axes="xz",
        ),
    }
    options = {"bars": "all"} if name == "rigid" else {}
    more = ("constraint_residual",) if name == "rigid" else ()
    made = {"formulation": formulation, "options": options, "keep": ("energy",)}
    return simulator(structures[name], "rk853", "rk54", more=more, **made)


def run(name: str, keep: str, method: str = "rk54", tol: float = 1e-6, samples: int = 11) -> Trajectory:
    options: dict[str, Any] = {
        "method": method,
        "rtol": tol,
        "stepping": Stepping(atol=tol, keep=keep, control="steps"),
    }
    return simulate(model_of(name), SPAN, samples=samples, **options)


def drift(found: Trajectory) -> float:
    energy = found.total_energy
    return float(np.abs(energy - energy[0]).max() / abs(energy[0]))


@pytest.mark.parametrize("name", ["free", "rigid", *thorough("heavy", "hung", "plane")])
def test_the_energy_stays_to_rounding_also_between_steps(name: str) -> None:
    kept, plain = run(name, "energy", samples=101), run(name, "", samples=101)
    assert kept.status == "ok"
    assert drift(kept) < 4e-13
    assert drift(plain) > 30 * drift(kept)


def momenta(found: Trajectory, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    linear = np.einsum("nm,tma->ta", mass, found.node_velocity)
    angular = np.einsum(
        "nm,tnma->ta", mass, np.cross(found.node_position[:, :, None], found.node_velocity[:, None])
    )
    return linear, angular


@pytest.mark.parametrize("name", ["free", "rigid", *thorough("heavy")])
def test_momentum_and_angular_momentum_stay_as_they_are_without_it(name: str) -> None:
    structure = flying(0.0 if name == "free" else 0.4)
    mass = np.diag(structure.node_mass)
    for e in np.flatnonzero(structure.member_mass):
        i, j = structure.connectivity[e]
        mass[np.ix_([i, j], [i, j])] += structure.member_mass[e] / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
    for keep in ("energy", ""):
        linear, angular = momenta(run(name, keep, "rk853", 1e-9, samples=2), mass)
        assert np.abs(linear - linear[0]).max() < 1e-11
        assert np.abs(angular - angular[0]).max() < 5e-10


def test_bars_keep_their_lengths_and_velocities_along_them_vanish() -> None:
    model, found = model_of("rigid"), run("rigid", "energy", samples=21)
    assert found.log.count > 3  # cables go slack and taut on the way
    for q, v in zip(found.coordinate, found.velocity, strict=True):
        assert np.abs(model.compute("constraint_residual", coordinate=q, velocity=v)).max() < 1e-13


def test_the_motion_stays_as_exact_as_its_tolerance() -> None:
    exact = run("free", "", "rk853", 1e-12)
    for method in ("rk54", "rk853"):
        kept, plain = (
            np.abs(run("free", k, method, 1e-8).coordinate - exact.coordinate).max() for k in ("energy", "")
        )
        assert kept < 30 * plain + 1e-9


def test_auto_takes_an_explicit_method() -> None:
    found = run("free", "energy", "auto")
    assert "the error at the samples is not estimated" in found.message
    usual = simulate(
        model_of("free"), SPAN, samples=11, rtol=1e-6, stepping=Stepping(atol=1e-6, keep="energy")
    )
    assert np.array_equal(usual.coordinate, found.coordinate)
    assert (found.status, found.method, found.error_estimate) == ("ok", "auto (rk853)", None)
    checked = simulate(
        model_of("free"), SPAN, samples=11, stepping=Stepping(keep="energy", control="samples")
    )
    assert (checked.status, checked.error_estimate <= 1.0) == ("ok", True)


def test_what_cannot_keep_energy_is_refused_with_the_reason() -> None:
    with pytest.raises(FormulationError, match="damping takes some"):
        simulator(pendulums(10.0), "rk54", keep=("energy",))
    with pytest.raises(FormulationError, match="node coordinates"):
        simulator(flying(), "rk54", formulation="node_distance", keep=("energy",))
    with pytest.raises(FormulationError, match="not built to keep"):
        simulate(simulator(flying(), "rk54"), 1.0, method="rk54", stepping=Stepping(keep="energy"))
    with pytest.raises(InvalidValueError, match="cannot keep"):
        run("free", "energy", "radau")
    with pytest.raises(UnknownNameError, match="unknown quantity to keep constant"):
        run("free", "enrgy")
