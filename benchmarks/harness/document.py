"""The committed page docs/benchmarks.md: a run in tables, with what the words mean."""

from collections.abc import Sequence
from pathlib import Path

from harness.comparison import comparison_cells, describe_finding, describe_rows
from harness.report import Report
from harness.summary import large_cells, summary_sections
from harness.tables import floor_cells, growth_cells, markdown_table

CHART = "<!-- site: bars structure, quantity: its time over ours -->\n"
OPENING = """\
## What the rows are

Written by `make bench`; figures as measured in one run.

- **Ours**: the C functions of generated libraries, called from C with all their checks, named by emitter,
  compiler and flag set (`reference`: to be bit-equal to CasADi's virtual machine, `native` is for this
  CPU). A batch evaluates 8 states in one call; its figures are for one state.
- **CasADi C**: C that CasADi writes, by `-O3 -march=native`: the unrolled SX expression, or an MX `map`
  over the members with sparse sums. Unrolled C was not attempted above 1,000 members, and above 100 for
  anything but the force. **CasADi VM**: its virtual machine, through buffers.
- **NumPy**: whole arrays, summed by a sparse incidence matrix or by `add.at`. **numba**: one loop over the
  members with fast math. **JAX**: `jit` in double precision on one core. All three are called from Python,
  as their users do.
- **MuJoCo**: the same structure as point masses on slide joints and tendons with springs. `mj_forward`,
  called from C, computes more than the force (kinematics, tendon Jacobians, mass matrix, accelerations) and
  no stiffness.

`node_force` is the force on every node, `tangent_stiffness` the Jacobian of the static force on the free
coordinates, `state_jacobian` that of the state derivative. All structures have point masses and no damping,
so that every peer can state the same physics; prism and icosahedron are the shipped scenes without damping
and masses of bars, the tower is a stack of prisms on an anchored ring, 9 members a level. Every result is
compared with ours before it is timed. Candidates take turns, 15 rounds; figures are medians of processor
time on one core, ratios medians over rounds. Floors are the arithmetic of one member's force: all in
registers, or from and to the level 1 cache, with square root and division or with `rsqrt14` and two Newton
steps.
"""


def write_document(report: Report, path: Path) -> None:
    """Write the page."""
    sections: list[tuple[str, Sequence[Sequence[str]]]] = [
        ("Machine", [["what", "value"], *([key, value] for key, value in report.machine.items())]),
        ("From a scene to a loaded library", large_cells(report.large)),
        *([("Floor of this core", floor_cells(report.floor))] if report.floor else []),
        *summary_sections(report.rows),
        ("Growth: exponents over the towers", growth_cells(report.rows)),
    ]
    compared = comparison_cells(report.rows)
    finding = f"**{describe_finding(report.rows)}.** {describe_rows(report.rows)}\n"
    tables = (f"## {title}\n\n{markdown_table(cells)}" for title, cells in sections if len(cells) > 1)
    comparison = f"{CHART}\n## Against the fastest other way\n\n{markdown_table(compared)}"
    parts = ["# Benchmarks\n", finding, *([comparison] if len(compared) > 1 else []), OPENING, *tables]
    path.write_text("\n".join(parts), encoding="utf-8")
