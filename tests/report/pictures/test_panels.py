import numpy as np
import pytest

from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.plots import draw_drift, draw_energies, draw_tensions, group_members
from tests.report.samples import make_trajectory
from tests.runtime.build import prism


def panel():
    return new_figure(4.0, 3.0).add_subplot()


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_energies_add_up_and_potential_counts_from_its_least_value():
    axes, run = panel(), make_trajectory(prism(), 21)
    draw_energies(axes, run)
    drawn = {name: np.asarray(line.get_ydata()) for name, line in lines(axes).items()}
    assert np.allclose(drawn["kinetic"] + drawn["potential"], drawn["total"], atol=1e-12)
    assert drawn["potential"].min() == pytest.approx(0.0, abs=1e-12)
    assert np.array_equal(drawn["kinetic"], run.kinetic_energy)
    assert axes.get_title(loc="left") == f"potential above {2.0 - run.kinetic_energy.max():.4g} J"


def test_few_members_are_lines_many_are_a_band_around_the_median():
    axes, structure = panel(), prism()
    run = make_trajectory(structure, 21)
    draw_tensions(axes, structure, run)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["bar c (3)", "cable c (9), median"]
    # The zero line, three bars, one median.
    assert len(axes.get_lines()) == 5
    assert len(axes.collections) == 1
    assert np.allclose(lines(axes)["cable c (9), median"].get_ydata(), run.member_tension[:, 3])


def test_members_are_grouped_by_class_bars_first_and_by_kind_where_classes_are_many():
    structure = prism()
    named = structure.with_changes(member_class=("cable", "bar") * 6)
    groups = group_members(named)
    assert next(iter(groups)) == "bar cable"
    assert sorted(e for members in groups.values() for e in members) == list(range(12))
    many = structure.with_changes(member_class=tuple(f"k{e}" for e in range(12)))
    assert {name: len(members) for name, members in group_members(many).items()} == {"bars": 3, "cables": 9}


def test_drift_is_the_change_of_energy_over_the_largest_kinetic_energy():
    run = make_trajectory(
        prism(), 5, total_energy=2.0 + np.array([0.0, 0.1, 0.2, 0.3, 0.4]), energy_drift=0.8
    )
    axes = panel()
    draw_drift(axes, prism(), run)
    drawn = np.asarray(axes.get_lines()[1].get_ydata())
    assert np.allclose(drawn, np.array([0.0, 0.1, 0.2, 0.3, 0.4]) / run.kinetic_energy.max())
    assert axes.get_title(loc="right").endswith("drift 0.8")


def test_damping_is_named_where_energy_may_go():
    structure = prism().with_changes(damping=np.ones(12))
    axes = panel()
    draw_drift(axes, structure, make_trajectory(structure, energy_drift=None))
    assert axes.get_title(loc="right").endswith("damping takes energy away")


def test_a_structure_at_rest_has_no_drift():
    axes = panel()
    zero = np.zeros(3)
    draw_drift(axes, prism(), make_trajectory(prism(), 3, kinetic_energy=zero, total_energy=zero))
    assert not np.any(axes.get_lines()[1].get_ydata())
