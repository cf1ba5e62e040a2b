"""Modes of a linear model as text."""

import numpy as np
from rich.console import Console

from tensegrity_codegen.report.result_tables import modes_table, say_finding, say_spectrum
from tensegrity_codegen.runtime.linear.spectrum import find_spectrum


def text(item: object) -> str:
    console = Console(width=80)
    with console.capture() as kept:
        console.print(item)
    return kept.get()


def test_every_mode_has_its_frequency_and_damping_ratio() -> None:
    lines = text(modes_table(np.array([1.5, 2.5]), np.array([0.0, 0.125]))).split()
    assert "frequency" in lines
    assert "damping" in lines
    assert lines[-6:] == ["1", "1.5", "0", "2", "2.5", "0.125"]


def test_what_does_not_oscillate_is_said_in_words() -> None:
    matrix = np.array([[0.0, 1.0], [-1.0, -2.5]])  # roots -0.5 and -2
    spectrum = find_spectrum(matrix, 20)
    assert say_finding(np.zeros(0), spectrum) == "no motion grows exponentially; no mode oscillates"
    assert say_spectrum(spectrum) == [
        "real eigenvalues [1/s] (motions that decay or grow without oscillation): -2, -0.5",
    ]
    matrix = np.zeros((4, 4))
    matrix[:2, 2:] = np.eye(2)
    matrix[2, 0] = 4.0  # one grows by 2/s, one is free
    said = " ".join(say_spectrum(find_spectrum(matrix, 20)))
    assert "2 eigenvalues are zero" in said
    finding = say_finding(np.array([2.5]), find_spectrum(matrix, 20))
    assert finding.startswith(
        "unstable: 1 eigenvalue has a positive real part; lowest natural frequency 2.5 Hz"
    )
