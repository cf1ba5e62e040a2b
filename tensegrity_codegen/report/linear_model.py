"""The modes of a linear model, for the terminal."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count

REAL = 1e-9  # imaginary part over modulus, up to which an eigenvalue is a real one


class Eigenvalues(Protocol):
    """Eigenvalues of a state matrix, see runtime.spectrum."""

    @property
    def eigenvalue(self) -> NDArray[np.complex128]:
        """All of them, ascending by modulus [1/s]."""

    @property
    def is_complete(self) -> bool:
        """Whether none is missing."""

    @property
    def zero_eigenvalues(self) -> int:
        """How many are zero to rounding."""

    @property
    def growing(self) -> int:
        """How many have a positive real part."""


def modes_table(frequency: FloatArray, damping: FloatArray, most: int) -> Table:
    """Return a table of the oscillating modes: frequency [Hz] and damping ratio; at most `most` rows."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for name in ("mode", "frequency [Hz]", "damping ratio"):
        table.add_column(name, justify="right")
    for number, (f, zeta) in enumerate(zip(frequency[:most], damping[:most], strict=True), 1):
        table.add_row(str(number), f"{f:.6g}", f"{zeta:.4g}")
    return table


def say_finding(frequency: FloatArray, spectrum: Eigenvalues) -> str:
    """Return whether motions grow, and the lowest natural frequency [Hz], as a sentence."""
    finding = "no motion grows exponentially"
    if spectrum.growing:
        growing = describe_count(spectrum.growing, "eigenvalue has", "eigenvalues have")
        finding = f"unstable: {growing} a positive real part"
    if not len(frequency):
        return f"{finding}; no mode oscillates"
    return f"{finding}; lowest natural frequency {frequency.min():.6g} Hz of {len(frequency)}"


def say_spectrum(spectrum: Eigenvalues, most: int) -> list[str]:
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
