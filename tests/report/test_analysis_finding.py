"""The headline of an analysis: stable or not and why, mechanisms, frequency, exceeded limits."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.report.analysis_tables import describe_analysis_finding, describe_counts
from tensegrity_codegen.runtime.analysis.analyse import Analysis, analyse
from tensegrity_codegen.structure.member_limits import Exceeded
from tests.reference import ReferenceModel
from tests.runtime.build import cable, make_structure, prism


@pytest.fixture(scope="module")
def stable() -> Analysis:
    return analyse(ReferenceModel(prism()), n_modes=8)


def test_a_prestress_that_stiffens_a_mechanism(stable: Analysis) -> None:
    text = describe_analysis_finding(stable)
    part = 100 * stable.prestress.least_tension / stable.prestress.largest_force
    assert stable.modes is not None
    assert text == (
        f"Stable: 1 self-stress, every cable in tension (at least {part:.3g} % of the largest force); 1 "
        f"mechanism, stiffened by tensions; lowest natural frequency {stable.modes.frequency[0]:.3g} Hz"
    )


def test_a_shape_without_prestress_counts_the_slack_cables() -> None:
    found = analyse(ReferenceModel(prism(160.0)), n_modes=0)
    assert describe_analysis_finding(found) == (
        "No prestress exists: 9 cables can only be slack, for a motion shortens them, lengthens no cable and "
        "changes no bar"
    )


def test_loads_that_keep_cables_in_tension() -> None:
    thread = make_structure(
        [(0, 0, 0), (0, 0, -1)], [cable(0, 1, 0.8)], axes="z", anchored={0: "z"}, load={1: (0.0, 0.0, -5.0)}
    )
    text = describe_analysis_finding(analyse(ReferenceModel(thread), n_modes=0))
    assert text == "Stable under its loads, which can tighten every cable to 5 N or more; no mechanism"


def test_unstable_structures_state_the_missing_stiffness(stable: Analysis) -> None:
    loose = replace(stable.stability, is_stable=False, smallest_eigenvalue=-0.25)
    found = replace(stable, status="unstable", stability=loose, modes=None)
    assert describe_analysis_finding(found) == (
        "Unstable: the tensions found give the only mechanism a stiffness of −0.25 of the largest force "
        "density"
    )
    rounded = replace(found, stability=replace(loose, smallest_eigenvalue=-0.123456))
    assert rounded.describe_loose().endswith("a stiffness of -0.123 of the largest force density")
    assert describe_analysis_finding(rounded).endswith("a stiffness of −0.123 of the largest force density")
    assert ("stiffness of mechanisms by tensions", "-0.123 of the largest force density") in describe_counts(
        rounded
    )
    neutral = replace(found, stability=replace(loose, smallest_eigenvalue=1e-15))
    assert describe_analysis_finding(neutral).endswith("the only mechanism no stiffness")
    for values, words in (
        ((0.0, 1e-16, -1e-16), "all 3"),
        ((0.0, 1e-16, 0.2), "2 of 3"),
        ((0.0, 1.0, 2.0), "one of 3"),
    ):
        eigenvalue = np.sort(values)
        three = replace(loose, eigenvalue=eigenvalue, smallest_eigenvalue=eigenvalue[0])
        several = replace(found, mechanism=np.zeros((6, 3, 3)), stability=three)
        assert describe_analysis_finding(several).endswith(f"give {words} mechanisms no stiffness")
    present = replace(stable, status="unstable", smallest_eigenvalue=-12.5, modes=None)
    assert describe_analysis_finding(present) == (
        "Unstable at the present tensions: the smallest eigenvalue of the stiffness is −12.5 N/m"
    )


def test_undecided_structures_state_the_rank(stable: Analysis) -> None:
    text = describe_analysis_finding(replace(stable, status="undecided"))
    assert text.startswith("Undecided: within rounding")
    assert f"rank {stable.rank.rank} of {stable.rank.largest_rank}" in text


def test_modes_that_grow_or_have_no_stiffness_are_counted(stable: Analysis) -> None:
    assert stable.modes is not None
    frequency, rate = np.array([0.0, 0.0, 2.5]), np.array([3.0, 0.0, 0.0])
    growing = replace(stable.modes, frequency=frequency, growth_rate=rate)
    assert describe_analysis_finding(replace(stable, modes=growing)).endswith(
        "1 unstable mode at the present tensions, the fastest grows by 3 1/s"
    )
    soft = replace(growing, growth_rate=np.zeros(3))
    assert describe_analysis_finding(replace(stable, modes=soft)).endswith(
        "lowest natural frequency 2.5 Hz, 2 modes without stiffness"
    )
    none = replace(soft, frequency=np.zeros(3))
    assert describe_analysis_finding(replace(stable, modes=none)).endswith(
        "no natural frequency, 3 modes without stiffness"
    )


def test_the_member_farthest_beyond_its_limit_is_named(stable: Analysis) -> None:
    buckled = (Exceeded("bar1", "buckling", 0.8, 1.0, 1.25), Exceeded("bar2", "buckling", 0.9, 1.0, 1.11))
    assert describe_analysis_finding(
        replace(stable, members=replace(stable.members, doubtful=buckled))
    ).endswith("; bar1 buckles: its compression is 1.25 times Euler's load (and 1 more member)")
    beyond = replace(stable.members, exceeded=(Exceeded("bar1", "yield_stress", 3e8, 2e8, 1.5),))
    assert describe_analysis_finding(replace(stable, members=beyond)).endswith(
        "; bar1 has a stress of 300 MPa, allowed is at most 200 MPa"
    )
