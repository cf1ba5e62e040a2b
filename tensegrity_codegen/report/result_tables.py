"""Results of verbs as tables and sentences for the terminal: modes, load paths, sensitivities, pages."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from tensegrity_codegen.report.long_table import LongTable, add_row, new_table, rank_rows
from tensegrity_codegen.report.pages.page import Page
from tensegrity_codegen.runtime.contacts.rest_memory import name_plastic
from tensegrity_codegen.runtime.paths.load_path import LoadPath, PathEvent
from tensegrity_codegen.runtime.paths.model_path import ModelPath
from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import name_list
from tensegrity_codegen.system.files import check_ending, plain, write_text
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.table_files import write_csv
from tensegrity_codegen.tables.body_places import show_members, show_nodes

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.linear.spectrum import Spectrum

REAL = 1e-9  # imaginary part over modulus, up to which an eigenvalue is a real one
MAX_REAL = 20  # real eigenvalues in a sentence
# Events of a path that end or change it; the others are those of members.
OF_THE_PATH = ("limit", "stability", "bifurcation", "contact", "separation")


def modes_table(frequency: FloatArray, damping: FloatArray) -> LongTable:
    """Return a table of the oscillating modes: frequency [Hz] and damping ratio, the lowest first."""
    return LongTable(
        "", ("mode", "frequency [Hz]", "damping ratio"), "rrr", len(frequency),
        lambda k: (str(k + 1), f"{frequency[k]:.6g}", f"{damping[k]:.4g}"), "modes",
        (("lowest", range(len(frequency))),),
    )  # fmt: skip


def say_finding(frequency: FloatArray, spectrum: "Spectrum") -> str:
    """Return whether motions grow, and the lowest natural frequency [Hz], as a sentence."""
    finding = "no motion grows exponentially"
    if spectrum.growing:
        growing = describe_count(spectrum.growing, "eigenvalue has", "eigenvalues have")
        finding = f"unstable: {growing} a positive real part"
    if not len(frequency):
        return f"{finding}; no mode oscillates"
    return f"{finding}; lowest natural frequency {frequency.min():.6g} Hz of {len(frequency)}"


def say_spectrum(spectrum: "Spectrum") -> list[str]:
    """Return a sentence for each fact that the table of oscillating modes does not show."""
    value, zeros = spectrum.eigenvalue, spectrum.zero_eigenvalues
    moving = value[zeros:]
    real = np.sort(moving[np.abs(moving.imag) <= REAL * np.abs(moving)].real)
    sentences = []
    if not spectrum.is_complete:
        sentences.append("only the slowest modes were computed")
    if len(real):
        listed = name_list([f"{x:.6g}" for x in real], MAX_REAL)
        sentences.append(f"real eigenvalues [1/s] (motions that decay or grow without oscillation): {listed}")
    if zeros:
        are = describe_count(zeros, "eigenvalue is", "eigenvalues are")
        sentences.append(f"{are} zero: rigid motions and mechanisms, two each")
    return sentences


def tabulate_path(path: LoadPath, model: ModelPath) -> dict[str, FloatArray]:
    """Return the columns of a table with one row a point, name -> (n_points,).

    Load factor, smallest eigenvalue, residual, coordinates by name, and where the model computes them
    plastic_<member> [m], length_<member> [m], tension_<member> [N] and distance_<pair> [m].
    """
    manifest = model.model.manifest
    columns = {
        "load_factor": path.load_factor,
        "smallest_eigenvalue": path.smallest_eigenvalue,
        "residual": path.residual,
    }
    columns |= _columns("", manifest.coordinate_name, path.coordinate)
    if path.internal is not None:
        plastic = [name_plastic(manifest.internal_name, row) for row in path.internal]
        columns |= {f"plastic_{name}": np.array([row[name] for row in plastic]) for name in plastic[0]}
    for prefix, quantity, names in (
        ("length_", "member_length", manifest.member_name),
        ("tension_", "member_tension", manifest.member_name),
        ("distance_", "bar_distance", manifest.bar_pair_name),
    ):
        if model.offers(quantity) and names:
            rows = [_compute_at(path, model, quantity, k) for k in range(len(path.load_factor))]
            columns |= _columns(prefix, names, np.array(rows))
    return columns


def _compute_at(path: LoadPath, model: ModelPath, quantity: str, k: int) -> Any:
    """Return a quantity at point k of a path, whose members come from there."""
    if path.internal is not None and model.memory is not None:
        model.memory.start = path.internal[k]
    return model.compute(quantity, path.coordinate[k], float(path.load_factor[k]))


def write_path(columns: dict[str, FloatArray], path: LoadPath, file: Path, *, overwrite: bool) -> None:
    """Write a table of points, and to .json the events too, whole or not at all; OutputError if it fails."""
    check_ending(file, ".csv", ".json")
    if file.suffix.lower() == ".csv":
        rows = np.column_stack(list(columns.values())).tolist()
        write_csv(file, list(columns), rows, overwrite=overwrite)
        return
    data = path.as_evidence() | {"points": {name: values.tolist() for name, values in columns.items()}}
    write_text(json.dumps(plain(data), indent=1, allow_nan=False) + "\n", file, overwrite=overwrite)


def events_table(events: Sequence[PathEvent], all_names: bool = True, digits: int = 10) -> LongTable:
    """Return a table of the events in order; all_names: or the first ones of many."""
    limit = max(4, 30 // max(len(events), 1))

    def describe(k: int) -> tuple[str, ...]:
        names = events[k].names
        listed = name_list(names, len(names) if all_names else limit)
        return f"{events[k].load_factor:.{digits}g}", events[k].kind, listed

    path_events = [k for k, event in enumerate(events) if event.kind in OF_THE_PATH]
    order = dict.fromkeys([*find_first_events(events), *path_events, *range(len(events))])
    return LongTable(
        "events", ("load factor", "event", "of"), "rff", len(events), describe, "events",
        (("first of each kind and limit, of the whole path, earliest", list(order)),),
    )  # fmt: skip


def find_first_events(events: Sequence[PathEvent]) -> list[int]:
    """Return the numbers of the first event of each kind, and of each limit "NAME (limit)" of members."""
    firsts: dict[tuple[str, str], int] = {}
    for k, event in enumerate(events):
        for name in event.names or ("",):
            firsts.setdefault((event.kind, name.partition(" (")[2]), k)
    return list(dict.fromkeys(firsts.values()))


def describe_excess(events: Sequence[PathEvent], digits: int) -> list[str]:
    """Return a sentence about the load factor at which members first exceed a limit, if any do."""
    excess = next((event for event in events if event.kind == "exceeded"), None)
    if excess is None:
        return []
    return [f"{name_list(excess.names, 1)} first exceeded at load factor {excess.load_factor:.{digits}g}"]


def _columns(prefix: str, names: Sequence[str], rows: FloatArray) -> dict[str, FloatArray]:
    table = rows.reshape(len(rows), len(names))
    return {f"{prefix}{name}": table[:, k] for k, name in enumerate(names)}


def list_columns(sensitivity: Sensitivity) -> dict[str, dict[str, Any]]:
    """Return the largest effects of each column, by its name.

    Returns name -> `node` and its `motion` [m/m], the node that moves most; `raised` and `lowered`, the
    members whose tensions rise and fall most, each with `derivative` [N/m], or None if none does.
    """
    n_nodes = len(show_nodes(sensitivity.node_name, sensitivity.bodies))
    n_members = len(show_members(sensitivity.member_name, sensitivity.bodies))
    size = np.linalg.norm(sensitivity.node[:n_nodes], axis=1)  # (n_nodes, n_columns)
    result: dict[str, dict[str, Any]] = {}
    for k, name in enumerate(sensitivity.column_name):
        node, change = int(size[:, k].argmax()), sensitivity.tension[:n_members, k]
        result[name] = {
            "node": sensitivity.node_name[node],
            "motion": sensitivity.node[node, :, k].tolist(),
            "raised": _extreme(sensitivity, change, int(change.argmax()), 1.0),
            "lowered": _extreme(sensitivity, change, int(change.argmin()), -1.0),
        }
    return result


def _extreme(sensitivity: Sensitivity, change: Any, member: int, sign: float) -> dict[str, Any] | None:
    value = float(change[member])
    return {"member": sensitivity.member_name[member], "derivative": value} if sign * value > 0 else None


def columns_table(columns: Mapping[str, Mapping[str, Any]]) -> LongTable:
    """Return a table of the largest effects of one millimetre more rest length, column by column."""
    names = list(columns)
    motion = np.array([np.linalg.norm(facts["motion"]) for facts in columns.values()])
    change = np.array([_find_change(facts) for facts in columns.values()])

    def describe(k: int) -> list[str]:
        facts = columns[names[k]]
        cells = [names[k], facts["node"], f"{motion[k]:.3g}"]
        for extreme in (facts["raised"], facts["lowered"]):
            cells += (
                ["", ""] if extreme is None else [extreme["member"], f"{extreme['derivative'] / 1e3:+.3g}"]
            )
        return cells

    return LongTable(
        "per mm of rest length: the node that moves most, the tensions that rise and fall most",
        ("of", "node", "moves [mm]", "rises", "[N]", "falls", "[N]"), "ffrfrfr", len(names), describe,
        "rest lengths",
        (
            ("those that move a node most", rank_rows(-motion)),
            ("those that change a tension most", rank_rows(-change)),
        ),
    )  # fmt: skip


def _find_change(facts: Mapping[str, Any]) -> float:
    """Return the largest change of a tension of one column [N/m]."""
    return max(
        (abs(extreme["derivative"]) for extreme in (facts["raised"], facts["lowered"]) if extreme),
        default=0.0,
    )


def ranks_table(title: str, unit: str, ranks: Sequence[tuple[str, float]]) -> Table:
    """Return a table of the columns that do most, with their derivatives."""
    table = new_table(title, "rest length of", **{f"derivative [{unit}]": "right"})
    for name, value in ranks:
        add_row(table, name, f"{value:+.6g}")
    return table


def values_table(rows: Sequence[tuple[str, float, float, float, float, float]]) -> Table:
    """Return a table of numbers found: key, value, standard error, both ends of the interval, start."""
    columns = ("value", "standard error", "95 % from", "to", "start")
    table = new_table("", "number", **dict.fromkeys(columns, "right"))
    for key, value, error, *others in rows:
        add_row(table, key, f"{value:.8g}", f"{error:.2g}", *(f"{number:.6g}" for number in others))
    return table


def outcome_table(page: Page) -> Table:
    """Return a table with a row for each section of the page: paper, place, title, verdict."""
    table = new_table("", "paper", "there", "what", "result")
    for chapter in page.chapters:
        for section in chapter.sections:
            add_row(table, chapter.name, section.source, section.title, section.outcome)
    return table
