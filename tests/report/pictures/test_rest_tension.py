"""Tensions of rigid bars in pictures: solved for, or unknown; never a zero that is not one."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.report.pictures.shown import find_rest_tension
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import bar, make_structure, spring
from tests.runtime.rigid_reference import RigidReference


def toggle(mass: float = 0.2) -> Structure:
    """Two rigid bars of 1 m at 30 degrees, one foot on a spring of 50 N/m, with a weight on top."""
    c = float(np.cos(np.radians(30)))
    place = [[0, 0, 0], [2 * c, 0, 0], [c, 0, 0.5], [2 * c + 1, 0, 0]]
    members = [bar(0, 2, 1.0, 0.0, mass=0.2), bar(2, 1, 1.0, 0.0), spring(1, 3, 1.0, 50.0)]
    held = {0: "xz", 1: "z", 3: "xz"}
    return make_structure(
        place, members, anchored=held, axes="xz", gravity=(0, 0, -9.81), mass=mass, load={2: (0, 0, -1)}
    )


def test_at_rest_rigid_bars_have_the_tensions_of_the_equilibrium() -> None:
    structure = toggle()
    found = find_equilibrium(RigidReference(structure))
    settled = structure.with_changes(node_position=found.node_position)
    tension = find_rest_tension(settled)
    np.testing.assert_allclose(tension, found.member_tension, rtol=1e-7)
    assert tension[0] < -1


def test_out_of_balance_they_are_unknown() -> None:
    tension = find_rest_tension(toggle())
    assert np.isnan(tension[:2]).all()
    assert np.isfinite(tension[2])


def test_redundant_bars_are_unknown_and_others_are_not() -> None:
    # Two bars in line between anchors share a load in no known way; one that hangs below does not.
    place = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, -1]]
    members = [bar(0, 1, 1.0, 0.0), bar(1, 2, 1.0, 0.0), bar(1, 3, 1.0, 0.0), spring(1, 3, 0.9, 10.0)]
    held = {0: "xyz", 2: "xyz", 1: "yz"}
    structure = make_structure(place, members, anchored=held, gravity=(0, 0, -10))
    tension = find_rest_tension(structure)
    assert np.isnan(tension[:2]).all()
    assert tension[2] == pytest.approx(10 - 1.0)


def test_pictures_show_what_is_unknown(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from matplotlib.colors import to_rgba

    from tensegrity_codegen.report.pictures.canvas import UNKNOWN, new_figure
    from tensegrity_codegen.report.pictures.drawing import StructureDrawing
    from tensegrity_codegen.report.pictures.view import find_box, fit_view
    from tests.report.samples import plot_structure

    structure = toggle()
    tension = np.array([np.nan, -3.0, 2.0])
    place = structure.node_position
    view = fit_view(structure, find_box(place, structure.axes), place)
    drawing = StructureDrawing(new_figure(4, 4).add_subplot(), structure, view, tension_limit=3.0)
    drawing.show(place, tension)
    colors = {tuple(np.round(row, 6)) for row in drawing.artists[-2].get_colors()}
    assert tuple(np.round(to_rgba(UNKNOWN), 6)) in colors
    none = tuple(np.round(drawing.mappable.to_rgba(0.0), 6))
    assert none not in colors
    assert plot_structure(structure, tmp_path / "a.png", member_tension=tension).stat().st_size > 0


def test_bars_that_the_formulation_makes_rigid_have_no_tension_of_their_stiffness() -> None:
    structure = toggle()
    rigid = structure.is_rigid
    stiff = structure.with_changes(spring_constant=np.where(rigid, 1e6, structure.spring_constant))
    assert (
        np.abs(find_rest_tension(stiff)[:2]).max() < 1e-6
    )  # just at their rest lengths: no tension of springs
    assert np.isnan(find_rest_tension(stiff, rigid)[:2]).all()
    found = find_equilibrium(RigidReference(structure))
    settled = stiff.with_changes(node_position=found.node_position)
    np.testing.assert_allclose(find_rest_tension(settled, rigid), found.member_tension, rtol=1e-7)
