"""Equilibria of a chunk of cases."""

from typing import Any

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import CaseArguments
from tensegrity_codegen.analyses.cases.record import COORDINATE
from tensegrity_codegen.runtime.model.interface import require_double
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria


def find_case_equilibria(
    model: CompiledModel, case_arguments: CaseArguments, threads: int, **options: Any
) -> Equilibria:
    """Return the equilibria of cases; options: as of `find_equilibria`."""
    require_double(model.manifest, "the search for an equilibrium")
    start = case_arguments.all.get(COORDINATE, model.nominal(COORDINATE))
    if start.ndim == 1:
        start = np.tile(start, (case_arguments.count, 1))
    arguments = {
        name: array for name, array in case_arguments.all.items() if name not in (COORDINATE, "velocity")
    }
    return find_equilibria(model, coordinate=start, arguments=arguments, threads=threads, **options)
