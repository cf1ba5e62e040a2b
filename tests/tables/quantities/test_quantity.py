"""Sentences of quantities for a structure, and the works that sources name."""

import re

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.quantities.quantity import REFERENCES, WITHOUT, fit_sentence
from tensegrity_codegen.tables.request import ModelRequest
from tests.doc_tables import DOCS
from tests.runtime.build import cable, make_structure, spring

FEATURES = ("rigid bars", "slack cables", "damping")
CASES = [
    ("member_tension", (), "Member tensions t_e = mu_e (l_e - rho_e), positive in tension."),
    ("node_residual", (), "Static force on every free coordinate; zero in equilibrium."),
    ("elastic_energy", (), "Strain energy sum mu_e (l_e - rho_e)^2 / 2 of members."),
    (
        "spring_tension",
        ("rigid bars",),
        "Tensions of springs at rest, mu_e (l_e - rho_e); zero in rigid bars.",
    ),
    (
        "tension_jacobian",
        ("slack cables",),
        "Derivative of the member tensions to the coordinates at constant rest lengths; zero in the rows of "
        "slack cables.",
    ),
    (
        "cable_margin",
        ("slack cables",),
        "Margins of cables that go slack, l_e - rho_e: each pulls while its margin is positive.",
    ),
    *((name, FEATURES, QUANTITIES[name].sentence) for name in ("member_tension", "tension_jacobian")),
]


@pytest.mark.parametrize(("name", "features", "expected"), CASES)
def test_a_sentence_speaks_of_what_the_structure_has(
    name: str, features: tuple[str, ...], expected: str
) -> None:
    assert fit_sentence(QUANTITIES[name].sentence, features) == expected


def test_no_sentence_speaks_of_what_is_absent() -> None:
    for _, pattern, _ in WITHOUT[2:]:
        assert any(re.search(pattern, row.sentence) for row in QUANTITIES.values()), pattern
    for row in QUANTITIES.values():
        assert not re.search(r"slack cables|taut member|no damping", fit_sentence(row.sentence, ())), row.name


def test_a_header_speaks_of_its_scene_and_lists_its_sources() -> None:
    points = [[0, 0, 0], [1, 0, 0], [0.5, 0, 0.8]]
    request = ModelRequest(("member_tension", "elastic_energy"))
    plain = make_structure(points, [spring(0, 1, 0.9), spring(1, 2, 0.8), spring(2, 0, 0.8)])
    header = emit(plain, request, account=False).files["small.h"]
    assert "t_e = mu_e (l_e - rho_e), positive in tension.\n" in header
    assert not re.search("slack|damping|taut|velocity|N_STATES", header)
    assert header.count("Savin") == 1
    assert "Sultan" not in header
    damped = make_structure(points, [cable(0, 1, 0.9, damping=0.1), cable(1, 2, 0.8), cable(2, 0, 0.8)])
    assert QUANTITIES["member_tension"].sentence in emit(damped, request, account=False).files["small.h"]


def test_the_works_are_those_of_the_model_s_page() -> None:
    page = " ".join((DOCS / "model.md").read_text(encoding="utf-8").replace("*", "").split())
    for name, text in REFERENCES.items():
        assert name in page
        assert text.split('"')[1] in page
