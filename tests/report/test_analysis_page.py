"""The page of an analysis: what stands on it, and what a browser shows of it."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import compile_scene
from tensegrity_codegen.report.analysis_page import align_motions, build_analysis_page
from tensegrity_codegen.report.pages.page import Figure, Page, render_page
from tensegrity_codegen.report.pages.page_table import Table
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.reference import ReferenceModel
from tests.report.page_checks import check_in_browser, in_browser
from tests.report.page_html import check_static
from tests.rigid_scenes import HANGING as RODS
from tests.runtime.build import bar, cable, make_structure, prism

pytest.importorskip("matplotlib")
COMMAND = "tensegrity-codegen analyse <scene>.toml"


def page_of(structure) -> Page:
    found = analyse(ReferenceModel(structure), n_modes=8)
    return build_analysis_page(found, structure, structure.member_name, COMMAND)


@pytest.fixture(scope="module")
def stable() -> Page:
    return page_of(prism())


@pytest.fixture(scope="module")
def infeasible() -> Page:
    return page_of(prism(160.0))


def sections(page: Page) -> dict[str, tuple]:
    return {section.anchor: section.blocks for section in page.chapters[0].sections}


def test_a_stable_structure_has_mechanisms_and_modes(stable: Page) -> None:
    found = sections(stable)
    assert list(found) == [
        *("prestress", "found", "mechanisms", "modes", "members", "singular-values", "command"),
    ]
    assert len(found["mechanisms"]) == 1
    assert [type(block) for block in found["modes"]] == [Figure] * 6 + [Table]
    (picture,) = found["prestress"]
    assert isinstance(picture, Figure)
    assert max(np.abs(picture.data["tension"])) == pytest.approx(1.0)


def test_forces_that_are_not_in_balance_are_in_the_headline() -> None:
    page = page_of(prism(load={3: (0.0, 0.0, -50.0)}))
    assert page.title.endswith(" N here: settle it first")
    assert "no oscillations about an equilibrium" in render_page(page)


def test_modes_that_share_a_frequency_are_parted_by_a_rule() -> None:
    rng = np.random.default_rng(1)
    base = np.linalg.qr(rng.normal(size=(18, 4)))[0].reshape(6, 3, 4)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    turned = np.concatenate([base[..., :1], base[..., 1:3] @ turn, base[..., 3:]], axis=-1)
    value = np.array([1.0, 2.0, 2.0 + 1e-9, 3.0])
    one, other = align_motions(base, value), align_motions(turned, value)
    np.testing.assert_allclose(one, other, atol=1e-9)
    np.testing.assert_allclose(np.abs(one[..., [0, 3]]), np.abs(base[..., [0, 3]]), atol=1e-12)
    along = (one[:, 0] ** 2).sum(axis=0)
    assert along[1] > along[2]
    pair = np.stack([np.eye(3)[[0] * 5], np.eye(3)[[1] * 5]], axis=-1)  # a motion along x, one along y
    np.testing.assert_allclose(align_motions(pair @ turn, np.ones(2)), pair / np.sqrt(5), atol=1e-12)


def test_all_motions_of_a_page_are_drawn_at_one_scale(stable: Page) -> None:
    found = sections(stable)
    blocks = [block for name in ("mechanisms", "modes") for block in found[name] if isinstance(block, Figure)]
    assert len({(block.picture.width, block.picture.height) for block in blocks}) == 1
    assert all(">bar</text>" in block.picture.svg for block in blocks)


def test_a_proof_has_displacements_and_changes_of_length(infeasible: Page) -> None:
    tables = [block for block in sections(infeasible)["proof"] if isinstance(block, Table)]
    assert [len(table.rows) for table in tables] == [6, 12]
    change = [row[1].value for row in tables[1].rows]
    assert sorted(change)[:9] == pytest.approx([-1.0] * 9)


def test_loads_forces_of_supports_and_sections_are_on_the_page() -> None:
    hung = make_structure(
        [[0, 0, 1], [0, 0, 0]], [cable(0, 1, 0.9)], anchored={0: "xyz"}, load={1: (0, 0, -1.0)}
    )
    pull = float(hung.static_tension()[0])
    hung = hung.with_changes(
        node_load=pull * hung.node_load, axial_stiffness=hung.spring_constant * 0.9,
        spring_constant=np.zeros(1), radius=np.array([2e-3]),
    )  # fmt: skip
    page = page_of(hung)
    found = sections(page)
    _, table = found["forces"]
    assert [column.heading for column in table.filled.columns] == ["node", "load z [N]", "support z [N]"]
    force = [[cell.value for cell in row[1:]] for row in table.filled.rows]
    assert force == [[None, pytest.approx(pull)], [pytest.approx(-pull), None]]
    cells = [cell.value for cell in found["members"][1].filled.rows[0]]
    assert cells[:2] == ["c", 1]
    assert cells[3] == "2"
    lacking = sections(page_of(hung.with_changes(node_load=2 * hung.node_load)))["forces"]
    assert "no reactions" in lacking[0].caption
    assert len(lacking[1].filled.columns) == 2


def test_planar_structures_with_nothing_to_move() -> None:
    triangle = make_structure(
        [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
        [bar(0, 1, 1.0), bar(1, 2, 2**0.5), cable(2, 0, 0.9)],
        axes="xz",
        anchored={0: "xz", 1: "z"},
        load={2: (0.0, 0.0, 5.0)},
    )
    page = page_of(triangle)
    assert "proof" in sections(page)  # without its load the cable can only be slack
    assert "<svg" in render_page(page)


@pytest.mark.parametrize(("name", "number"), [("infeasible", "9"), *thorough(("stable", "1"))])
def test_the_finding_is_the_title(request: pytest.FixtureRequest, name: str, number: str) -> None:
    page = request.getfixturevalue(name)
    assert page.subject.startswith("Analysis of ")
    text = render_page(page)
    check_static(text, [number])
    assert "&lt;scene&gt;.toml" in text


@in_browser
@pytest.mark.parametrize("name", ["stable", "infeasible"])
def test_in_a_browser(request: pytest.FixtureRequest, tmp_path: Path, name: str) -> None:
    path = tmp_path / "page.html"
    path.write_text(render_page(request.getfixturevalue(name)), encoding="utf-8")
    check_in_browser(path, [])


def test_corners_and_edges_of_bodies_are_not_on_the_page() -> None:
    members = {**RODS["members"], "stay": {**RODS["members"]["tie"], "nodes": ["hook", "block.eye"]}}
    model = compile_scene({**RODS, "members": members}, for_="analyse")
    structure = model.structure
    assert isinstance(structure, Structure)
    page = build_analysis_page(analyse(model), structure, ("line", "tie", "stay"))
    text = render_page(page)
    assert "4 nodes, 3 members" in text
    assert "rod_corner" not in text
    assert "rod_edge" not in text
