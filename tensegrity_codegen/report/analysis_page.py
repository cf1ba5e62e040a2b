"""An analysis as a page: verdict, singular values, prestress, proof, mechanisms, modes, members."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from tensegrity_codegen.report.analysis_tables import (
    describe_analysis_finding,
    describe_counts,
)
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import (
    Block,
    Chapter,
    Figure,
    Page,
    Paragraph,
    Remark,
    Section,
    as_sentence,
    command_section,
    diagram_figure,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import draw_motion, draw_picture, draw_tensions
from tensegrity_codegen.report.pictures.draw import pad_tension
from tensegrity_codegen.report.state_page import forces_section, members_section
from tensegrity_codegen.runtime.analysis.analyse import Analysis
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.analysis.prestress import name_moving
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION

MAX_MECHANISMS, MAX_MODES = 4, 6
LEAD = (
    "Which tensions the structure can have in this configuration, which motions change no member's length, "
    "and whether tensions stiffen these. Tensions are positive, compressions negative. Motions are enlarged; "
    "dotted lines show the configuration itself."
)
EQUAL = 1e-5  # relative difference of frequencies below which modes share them
TIE = 1e-3  # of the weights of nodes, which part modes that symmetry would leave arbitrary


def build_analysis_page(
    analysis: Analysis, structure: Structure, member_name: tuple[str, ...], command: str = ""
) -> Page:
    """Return the page of an analysis.

    structure: the drawn one, its members first those of `member_name` (then edges of bodies); command: the
    command line that makes the page.
    """
    rows = tuple((text_cell(name), text_cell(value)) for name, value in describe_counts(analysis))
    table = Table(
        "Counts and stiffness", (Column("what", numeric=False), Column("value", numeric=False)), rows
    )
    blocks: list[Block] = [Remark("differs", as_sentence(text)) for text in analysis.warnings]
    blocks += [] if analysis.is_good else [Paragraph(as_sentence(analysis.message))]
    unbalanced = f"; out of balance by {format_short(analysis.residual)} N here: settle it first"
    unbalanced = "" if analysis.is_balanced else unbalanced
    motions = _choose_motions(analysis)
    sections = (
        _prestress(analysis, structure),
        Section("found", "", "What was found", "plain", "", (*blocks, table)),
        *_proof(analysis, structure, member_name),
        *_mechanisms(analysis, structure, motions),
        *_modes(analysis, structure, motions),
        *_loads(analysis, structure),
        members_section(
            structure, analysis.member_tension, analysis.members, member_name, analysis.prestress.tension
        ),
        _singular_values(analysis),
        *([command_section(command)] if command else []),
    )
    counts = ", ".join(
        (
            describe_count(int((~structure.is_corner).sum()), "node"),
            describe_count(len(member_name), "member"),
        )
    )
    return Page(
        subject=f"Analysis of {structure.name}",
        title=describe_analysis_finding(analysis) + unbalanced,
        lead=LEAD,
        chapters=(Chapter("analysis", structure.name, "", f"{counts}.", sections),),
        facts=(f"tensegrity_codegen {VERSION}.", "Equations, signs and statuses: docs/analyse.md."),
    )


def _singular_values(analysis: Analysis) -> Section:
    rank = analysis.rank
    largest = float(rank.singular_value.max(initial=0.0)) or 1.0
    values = np.maximum(rank.singular_value / largest, rank.rounding)
    number = np.arange(1, len(values) + 1)
    series = [Series("not zero", number[: rank.rank], values[: rank.rank], "points")]
    if rank.rank < len(values):
        series.append(Series("zero", number[rank.rank :], values[rank.rank :], "points", color=1, marker="s"))
    diagram = Diagram(
        "number", "singular value / largest", series, log_y=True,
        horizontal=((rank.tolerance, "tolerance"),),
    )  # fmt: skip
    claim = f"rank {rank.rank} of {rank.largest_rank}"
    caption = "Singular values of the equilibrium matrix; those below the rounding error are drawn at it."
    blocks = (
        (diagram_figure("singular", diagram, caption, f"Singular values: {claim}"),) if len(values) else ()
    )
    return Section("singular-values", "", "Singular values", "plain", claim, blocks)


def _prestress(analysis: Analysis, structure: Structure) -> Section:
    selfstress, loaded = analysis.prestress, analysis.load_prestress
    if selfstress.is_found and not math.isinf(selfstress.least_tension):
        claim, tension = (
            "self-stress with every cable in tension; the largest force is 1",
            selfstress.tension,
        )
    elif loaded is not None and loaded.is_found:
        claim, tension = "tensions that balance the loads and are largest in the least cable", loaded.tension
    elif math.isinf(selfstress.least_tension):
        claim, tension = "no member needs to be in tension", selfstress.tension
    else:
        claim, tension = "no prestress exists; the present tensions are shown", analysis.member_tension
        if not analysis.is_balanced:
            claim += f", which are not in balance: up to {format_short(analysis.residual)} N are missing"
    unit = "member tension / largest force" if tension is selfstress.tension else "member tension [N]"
    # Tensions of all that is drawn; those of the edges of bodies are unknown
    picture = draw_tensions(structure, analysis.node_position, pad_tension(tension, structure), unit)
    figure = Figure(
        draw_picture(picture, "prestress"),
        as_sentence(claim),
        f"The structure, {claim}",
        {"tension": tension.tolist()},
    )
    return Section("prestress", "", "Prestress", "plain", claim, (figure,))


def _proof(analysis: Analysis, structure: Structure, member_name: tuple[str, ...]) -> Iterator[Section]:
    proof, motion = analysis.certificate, analysis.certificate_displacement
    if proof is None or motion is None or not proof.is_verified:
        return
    claim = f"{len(proof.shortening)} cables shorten, no cable lengthens, no bar changes its length"
    picture = draw_picture(draw_motion(structure, analysis.node_position, motion), "proof")
    figure = Figure(picture, f"The motion, enlarged: {claim}.", claim, {"displacement": motion.tolist()})
    axes = structure.axes
    columns = (Column("node", numeric=False), *(Column("xyz"[axis]) for axis in axes))
    rows = tuple(
        (text_cell(name), *(number_cell(float(motion[n, axis]), "+.6f") for axis in axes))
        for n, name in enumerate(structure.node_name)
        if not structure.is_corner[n]
    )
    moved = Table("Displacements d of the nodes, for a largest shortening of 1", columns, rows)
    lengths = tabulate_elongation(proof, member_name, "+.6f")
    why = Paragraph(
        "In these displacements a self-stress with every cable in tension would do negative work, but any "
        "self-stress does none: so there is no such self-stress."
    )
    title = "Why no self-stress keeps every cable in tension"
    yield Section("proof", "", title, "plain", claim, (why, figure, moved, lengths))


def tabulate_elongation(proof: Certificate, member_name: Sequence[str], spec: str) -> Table:
    """Return the table of the changes of length in the motion of a proof; spec: format of a change."""
    rows = tuple(
        (text_cell(name), number_cell(float(proof.elongation[e]), spec)) for e, name in enumerate(member_name)
    )
    note = (
        f"Measured: bars change by {proof.bar_change:.1e}, cables lengthen by {proof.cable_lengthening:.1e} "
        "at most."
    )
    columns = (Column("member", numeric=False), Column("change", "1"))
    return Table("Changes of length, A^T d", columns, rows, note)


def _choose_motions(analysis: Analysis) -> FloatArray:
    """Return the drawn mechanisms, then the drawn modes, (n_nodes, 3, n), of bases that a rule chooses."""
    modes, count = analysis.modes, analysis.n_mechanisms
    parts = [align_motions(analysis.mechanism, np.zeros(count))[..., :MAX_MECHANISMS]]
    if modes is not None:
        key = modes.frequency - modes.growth_rate
        parts.append(align_motions(modes.shape, key)[..., :MAX_MODES])
    return np.concatenate(parts, axis=-1)


def align_motions(motion: FloatArray, value: FloatArray) -> FloatArray:
    """Return motions (n_nodes, 3, n) of which those of equal value (n,) are parted along x and y.

    Any basis of the motions of a repeated eigenvalue is as good as another. This one makes the squared
    displacement along x stationary, which is large in the first; of a basis its signs are fixed too.
    """
    aligned = np.array(motion, dtype=float)
    weight = 1.0 + TIE * np.linspace(1.0, 0.0, len(aligned))
    start = 0
    for end in range(1, len(value) + 1):
        if end < len(value) and value[end] - value[start] <= EQUAL * max(np.abs(value).max(), 1e-300):
            continue
        base, _ = np.linalg.qr(aligned[..., start:end].reshape(-1, end - start))
        along = base.reshape(len(aligned), 3, -1)[:, 0] * np.sqrt(weight)[:, None]
        _, turn = np.linalg.eigh(-along.T @ along)
        block = base @ turn
        size = np.abs(block)
        leading = (size > (1 - EQUAL) * size.max(axis=0)).argmax(axis=0)
        block *= np.sign(block[leading, np.arange(end - start)])
        aligned[..., start:end] = block.reshape(len(aligned), 3, -1)
        start = end
    return aligned


def _mechanisms(analysis: Analysis, structure: Structure, motions: FloatArray) -> Iterator[Section]:
    count = analysis.n_mechanisms
    if count:
        claim = f"{count} motion{'s' * (count > 1)} that change{'s' * (count == 1)} no length to first order"
        figures = tuple(
            _motion_figure(
                structure,
                analysis,
                motions,
                k,
                f"mechanism{k + 1}",
                f"Mechanism {k + 1}, most of {name_moving(structure.node_label, motions[..., k])}.",
            )
            for k in range(min(count, MAX_MECHANISMS))
        )
        yield Section("mechanisms", "", "Mechanisms", "plain", claim, figures)


def _modes(analysis: Analysis, structure: Structure, motions: FloatArray) -> Iterator[Section]:
    modes = analysis.modes
    if modes is None or not len(modes.frequency):
        return
    figures = []
    offset = min(analysis.n_mechanisms, MAX_MECHANISMS)
    for k in range(min(len(modes.frequency), MAX_MODES)):
        caption = f"Mode {k + 1}: {modes.frequency[k]:.5g} Hz."
        if modes.growth_rate[k]:
            caption = f"Mode {k + 1}: unstable, grows by {modes.growth_rate[k]:.4g} 1/s."
        figures.append(_motion_figure(structure, analysis, motions, offset + k, f"mode{k + 1}", caption))
    claim = f"{len(figures)} of {modes.n_total} modes drawn"
    if not analysis.is_balanced:
        claim += "; the forces are not in balance here, so these are no oscillations about an equilibrium"
    columns = (Column("mode"), Column("frequency", "Hz"), Column("growth", "1/s"))
    rows = tuple(
        (
            number_cell(float(k + 1), ".0f"),
            number_cell(float(frequency), ".5g"),
            number_cell(float(rate) or None, ".4g"),
        )
        for k, (frequency, rate) in enumerate(zip(modes.frequency, modes.growth_rate, strict=True))
    )
    table = Table("Natural frequencies", columns, rows)
    name = "Natural frequencies at the present tensions"
    yield Section("modes", "", name, "plain", claim, (*figures, table))


def _motion_figure(
    structure: Structure, analysis: Analysis, motions: FloatArray, k: int, name: str, caption: str
) -> Figure:
    picture = draw_picture(draw_motion(structure, analysis.node_position, motions[..., k], motions), name)
    return Figure(picture, caption, caption, {"displacement": motions[..., k].tolist()})


def _loads(analysis: Analysis, structure: Structure) -> Iterator[Section]:
    """Return loads, and forces of supports if the forces are in balance; nothing without both."""
    if structure.node_load.any() or structure.node_anchored.any():
        tension = pad_tension(analysis.member_tension, structure) if analysis.is_balanced else None
        yield forces_section(structure, analysis.node_position, tension)
