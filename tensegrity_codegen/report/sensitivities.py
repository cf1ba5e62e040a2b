"""Sensitivities as tables: what each change of a rest length does, and which changes do most."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from tensegrity_codegen.runtime.sensitivity.record import Sensitivity


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
    table = _table(
        "per mm of rest length: the node that moves most, the tensions that rise and fall most",
        ("of", "node", "moves [mm]", "rises", "[N]", "falls", "[N]"),
    )
    for name, facts in list_columns(found).items():
        cells = [name, facts["node"], f"{np.linalg.norm(facts['motion']):.3g}"]
        for extreme in (facts["raised"], facts["lowered"]):
            cells += (
                ["", ""] if extreme is None else [extreme["member"], f"{extreme['derivative'] / 1e3:+.3g}"]
            )
        table.add_row(*(Text(cell) for cell in cells))
    return table


def ranks_table(title: str, unit: str, ranks: Sequence[tuple[str, float]]) -> Table:
    """Return a table of the columns that do most, with their derivatives."""
    table = _table(title, ("rest length of", f"derivative [{unit}]"))
    for name, value in ranks:
        table.add_row(Text(name), f"{value:+.6g}")
    return table


def _table(title: str, columns: Sequence[str]) -> Table:
    table = Table(
        title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    for name in columns:
        is_number = "[" in name
        table.add_column(
            Text(name), justify="right" if is_number else "left", no_wrap=is_number, overflow="fold"
        )
    return table
