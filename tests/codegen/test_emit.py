"""From a request to files: what is refused, and that equal requests give equal bytes."""

import hashlib
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.codegen import unrolled
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidNameError
from tensegrity_codegen.tables.manifest import ABI_VERSION, Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.subjects import bare, everything
from tests.models import load
from tests.runtime.build import bar, cable, make_structure, prism, spring

FINGERPRINT = """
import hashlib
from tensegrity_codegen.codegen.emit import emit
from tests.codegen.subjects import everything
files = emit(*everything()).files
print(hashlib.sha256("".join(name + files[name] for name in sorted(files)).encode()).hexdigest())
"""


def refuse(structure: Structure, request: ModelRequest) -> FormulationError:
    with pytest.raises(FormulationError) as caught:
        emit(structure, request)
    return caught.value


def test_an_unknown_emitter_is_refused_with_the_known_ones() -> None:
    structure, request = bare()
    error = refuse(structure, replace(request, emitter="tables"))
    assert (error.where, error.given) == ("model.emitter", "tables")
    assert "'table'" in error.hint


def test_an_unknown_formulation_is_refused_with_the_known_ones() -> None:
    structure, request = bare()
    error = refuse(structure, replace(request, formulation="node_positions"))
    assert (error.where, error.given) == ("model.formulation", "node_positions")
    assert "'node_position'" in error.hint


def test_an_unknown_integrator_is_refused_with_the_known_ones() -> None:
    structure, request = bare()
    error = refuse(structure, replace(request, integrators=("rk5",)))
    assert "'rk4'" in error.hint


def test_an_integrator_needs_the_acceleration() -> None:
    error = refuse(prism(), ModelRequest(("member_tension",), integrators=("rk4",)))
    assert "acceleration" in error.hint


def test_a_rigid_bar_is_refused_by_name_and_formulation() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [bar(0, 1, 1.0, mu=0.0)])
    error = refuse(structure, ModelRequest(("member_tension",)))
    assert "rigid_bar" in error.hint
    assert error.where == "small: members.e0"
    assert "e0" in str(error.given)


def test_a_free_node_without_mass_is_fine_for_statics_and_refused_for_dynamics() -> None:
    members = [spring(0, 1, 0.9), spring(1, 2, 0.9)]
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]], members, anchored={0: "xyz"}, mass=[0.0, 0.0, 1.0]
    )
    files = emit(structure, ModelRequest(EQUILIBRIUM_QUANTITIES)).files
    assert "small_compute_node_residual" in files["small.h"]
    error = refuse(structure, ModelRequest(("acceleration",)))
    assert "nodes.n1.mass" in error.where
    assert error.given == "no mass at n1"


def test_too_many_members_are_refused_before_any_expression_is_built() -> None:
    count = unrolled.MAX_MEMBERS + 1
    position = np.column_stack([np.arange(count + 1.0), np.zeros((count + 1, 2))])
    structure = make_structure(position, [spring(k, k + 1, 0.9) for k in range(count)])
    error = refuse(structure, ModelRequest(("member_tension",)))
    assert error.given == f"{count} members"
    assert str(unrolled.MAX_MEMBERS) in error.allowed


def test_too_many_operations_are_refused_with_an_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unrolled, "MAX_OPERATIONS", 500)
    error = refuse(prism(), ModelRequest(("state_jacobian",)))
    assert "operations" in str(error.given)
    assert "s to compile" in str(error.given)
    assert "500" in error.allowed


def test_the_files_are_those_of_a_package_to_embed() -> None:
    source = emit(*bare())
    assert set(source.files) == {"triangle.c", "triangle.h", "example.c", "Makefile", "manifest.json"}
    assert Manifest.from_json(source.files["manifest.json"]) == source.manifest
    assert source.manifest.abi_version == ABI_VERSION
    assert all("\t" not in text or name == "Makefile" for name, text in source.files.items())
    assert all(text.endswith("\n") for text in source.files.values())
    for name in ("triangle.c", "triangle.h", "example.c", "Makefile"):
        assert "do not edit" in source.files[name].splitlines()[0]


def test_two_emissions_are_equal_to_the_byte() -> None:
    first, second = emit(*bare()), emit(*bare())
    assert first.files == second.files


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.parametrize("seed", ["1", *thorough("2")])
def test_another_process_with_another_hash_seed_gives_the_same_bytes(seed: str) -> None:
    files = emit(*everything()).files
    own = hashlib.sha256("".join(name + files[name] for name in sorted(files)).encode()).hexdigest()
    environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", FINGERPRINT], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == own


def test_another_value_gives_another_hash() -> None:
    structure, request = bare()
    changed = structure.with_changes(rest_length=structure.rest_length * (1 + 1e-15))
    hashes = {emit(s, request).manifest.scene_hash for s in (structure, changed)}
    assert len(hashes) == 2


def test_a_scene_may_bear_the_name_of_the_integrator() -> None:
    structure = prism().with_changes(name="rk4")
    model = load(structure, "acceleration", integrators=("rk4",))
    assert model.compute("acceleration").shape == (18,)


def test_a_structure_without_a_free_coordinate_still_has_tensions() -> None:
    held = make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 0.9)], anchored={0: "xyz", 1: "xyz"})
    assert emit(held, ModelRequest(("member_tension",))).manifest.functions[0].arguments == ()


@pytest.mark.parametrize("field", ["node_name", "member_name"])
def test_names_of_a_structure_made_in_python_do_not_get_into_c_unchecked(field: str) -> None:
    structure = prism()
    first, *others = getattr(structure, field)
    changed = structure.with_changes(**{field: (f"{first} */ int x; /*", *others)})
    with pytest.raises(InvalidNameError, match="not a valid name"):
        emit(changed, ModelRequest(("member_tension",)))
