"""Results of verbs as tables and sentences for the terminal: modes, load paths, sensitivities, pages."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from tensegrity_codegen.report.pages.page import Page
from tensegrity_codegen.report.tables import add_row, new_table
from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.sensitivity.record import Sensitivity
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.files import check_ending, plain, write_text
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.table_files import write_csv

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.linear.spectrum import Spectrum

REAL = 1e-9  # imaginary part over modulus, up to which an eigenvalue is a real one


def modes_table(frequency: FloatArray, damping: FloatArray, most: int) -> Table:
    """Return a table of the oscillating modes: frequency [Hz] and damping ratio; at most `most` rows."""
    columns = dict.fromkeys(("mode", "frequency [Hz]", "damping ratio"), "right")
    table = new_table("", **columns)
    for number, (f, zeta) in enumerate(zip(frequency[:most], damping[:most], strict=True), 1):
        add_row(table, str(number), f"{f:.6g}", f"{zeta:.4g}")
    return table


def say_finding(frequency: FloatArray, spectrum: "Spectrum") -> str:
    """Return whether motions grow, and the lowest natural frequency [Hz], as a sentence."""
    finding = "no motion grows exponentially"
    if spectrum.growing:
        growing = describe_count(spectrum.growing, "eigenvalue has", "eigenvalues have")
        finding = f"unstable: {growing} a positive real part"
    if not len(frequency):
        return f"{finding}; no mode oscillates"
    return f"{finding}; lowest natural frequency {frequency.min():.6g} Hz of {len(frequency)}"


def say_spectrum(spectrum: "Spectrum", most: int) -> list[str]:
    """Return what the table of oscillating modes does not show, a sentence each."""
    value, zeros = spectrum.eigenvalue, spectrum.zero_eigenvalues
    moving = value[zeros:]
    real = np.sort(moving[np.abs(moving.imag) <= REAL * np.abs(moving)].real)
    count = int(np.sum(moving.imag > REAL * np.abs(moving)))
    said = []
    if count > most:
        said.append(f"{count - most} more modes: see `json`")
    if not spectrum.is_complete:
        said.append("only the slowest modes were computed")
    if len(real):
        listed = ", ".join(f"{x:.6g}" for x in real[:most]) + (" ..." if len(real) > most else "")
        said.append(f"real eigenvalues [1/s] (motions that decay or grow without oscillation): {listed}")
    if zeros:
        are = describe_count(zeros, "eigenvalue is", "eigenvalues are")
        said.append(f"{are} zero: rigid motions and mechanisms, two each")
    return said


def tabulate_path(path: LoadPath, model: ModelPath) -> dict[str, FloatArray]:
    """Return the columns of a table with one row a point, name -> (n_points,).

    Load factor, smallest eigenvalue, residual, coordinates by name, and where the model computes them
    length_<member> [m], tension_<member> [N] and distance_<pair> [m].
    """
    manifest = model.model.manifest
    columns = {
        "load_factor": path.load_factor,
        "smallest_eigenvalue": path.smallest_eigenvalue,
        "residual": path.residual,
    }
    columns |= _columns("", manifest.coordinate_name, path.coordinate)
    for prefix, quantity, names in (
        ("length_", "member_length", manifest.member_name),
        ("tension_", "member_tension", manifest.member_name),
        ("distance_", "bar_distance", manifest.bar_pair_name),
    ):
        if model.offers(quantity) and names:
            points = zip(path.coordinate, path.load_factor, strict=True)
            rows = [model.compute(quantity, coordinate, float(load)) for coordinate, load in points]
            columns |= _columns(prefix, names, np.array(rows))
    return columns


def write_path(columns: dict[str, FloatArray], path: LoadPath, file: Path, *, overwrite: bool) -> None:
    """Write a table of points, and to .json the events too, whole or not at all; OutputError if it fails."""
    check_ending(file, ".csv", ".json")
    if file.suffix.lower() == ".csv":
        rows = np.column_stack(list(columns.values())).tolist()
        write_csv(file, list(columns), rows, overwrite=overwrite)
        return
    data = path.as_evidence() | {"points": {name: values.tolist() for name, values in columns.items()}}
    write_text(json.dumps(plain(data), indent=1, allow_nan=False) + "\n", file, overwrite=overwrite)


def events_table(events: Sequence[PathEvent]) -> Table:
    """Return a table of the events in order."""
    table = Table("load factor", "event", "of", title="events", box=box.SIMPLE, title_justify="left")
    table.columns[0].justify = "right"
    for event in events:
        table.add_row(f"{event.load_factor:.10g}", event.kind, ", ".join(event.names))
    return table


def _columns(prefix: str, names: Sequence[str], rows: FloatArray) -> dict[str, FloatArray]:
    table = rows.reshape(len(rows), len(names))
    return {f"{prefix}{name}": table[:, k] for k, name in enumerate(names)}


def list_columns(found: Sensitivity) -> dict[str, dict[str, Any]]:
    """Return what each column does most, by its name.

    Returns
    -------
    dict
        Name -> `node` and its `motion` [m/m], the node that moves most; `raised` and `lowered`, the members
        whose tensions rise and fall most, each with `derivative` [N/m], or None where none does.
    """
    size = np.linalg.norm(found.node, axis=1)  # (n_nodes, n_columns)
    result: dict[str, dict[str, Any]] = {}
    for k, name in enumerate(found.column_name):
        node, change = int(size[:, k].argmax()), found.tension[:, k]
        result[name] = {
            "node": found.node_name[node],
            "motion": found.node[node, :, k].tolist(),
            "raised": _extreme(found, change, int(change.argmax()), 1.0),
            "lowered": _extreme(found, change, int(change.argmin()), -1.0),
        }
    return result


def _extreme(found: Sensitivity, change: Any, member: int, sign: float) -> dict[str, Any] | None:
    value = float(change[member])
    return {"member": found.member_name[member], "derivative": value} if sign * value > 0 else None


def columns_table(found: Sensitivity) -> Table:
    """Return a table of what one millimetre more rest length does most, column by column."""
    title = "per mm of rest length: the node that moves most, the tensions that rise and fall most"
    table = new_table(title)
    for name in ("of", "node", "moves [mm]", "rises", "[N]", "falls", "[N]"):
        is_number = "[" in name
        table.add_column(
            Text(name), justify="right" if is_number else "left", no_wrap=is_number, overflow="fold"
        )
    for name, facts in list_columns(found).items():
        cells = [name, facts["node"], f"{np.linalg.norm(facts['motion']):.3g}"]
        for extreme in (facts["raised"], facts["lowered"]):
            cells += (
                ["", ""] if extreme is None else [extreme["member"], f"{extreme['derivative'] / 1e3:+.3g}"]
            )
        add_row(table, *cells)
    return table


def ranks_table(title: str, unit: str, ranks: Sequence[tuple[str, float]]) -> Table:
    """Return a table of the columns that do most, with their derivatives."""
    table = new_table(title, "rest length of", **{f"derivative [{unit}]": "right"})
    for name, value in ranks:
        add_row(table, name, f"{value:+.6g}")
    return table


def outcome_table(page: Page) -> Table:
    """Return a table with a row for each section of the page: paper, place, title, verdict."""
    table = new_table("", "paper", "there", "what", "result")
    for chapter in page.chapters:
        for section in chapter.sections:
            add_row(table, chapter.name, section.source, section.title, section.outcome)
    return table
