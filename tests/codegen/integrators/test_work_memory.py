"""Sizes of work memory as Python reads them from the C structs, beside what sizeof says."""

from pathlib import Path

import pytest

from tensegrity_codegen.codegen.integrators.work_memory import count_bytes
from tests.codegen.plain_c.alone import options_for, run_c

MAIN = r"""
#include <stdio.h>
#include "collocation.h"
#include "explicit.h"
#include "radau.h"
#include "rk4.h"
#include "rodas.h"
int main(void)
{
  printf("%zu %zu ", sizeof(event_memory), sizeof(energy_memory));
  printf("%zu %zu %zu ", sizeof(radau_work), sizeof(method_work), sizeof(rk4_work));
  printf("%zu %zu\n", sizeof(rodas_memory), sizeof(collocation_memory));
  return 0;
}
"""


@pytest.mark.parametrize("n", [1, 15])
def test_sizes_are_those_of_the_compiler(n: int, tmp_path: Path) -> None:
    axes = 1 if n % 3 else 3
    sizes = {
        "N": n,
        "N_STATES": 2 * n,
        "N_SLOPES": n,
        "N_OLD": 3 * n,
        "AXES": axes,
        "N_MARGINS": 2,
        "N_MASSES": n,
        "N_STATE_JACOBIAN": 2 * n,
        "N_UNKNOWNS": n + 1 + (axes == 3),
        "N_DAMPED": int(axes == 3),
        "WITH_RADAU_DAMPED": int(axes == 3),
        "TENSION_ROOM": 1,
        "RADAU_LAW": 3 + axes,
        "RADAU_MASSES": n,
        "RADAU_ENTRY_ROOM": axes,
        "RADAU_FACTOR_ROOM": axes,
        "WITH_EVENTS": 1,
        "METHOD_RATES": 3,
        "METHOD_DENSE": 3,
        "METHOD_HAS_DENSE": 1,
        "METHOD_KEEPS_ENERGY": 1,
        "WITH_PROFILE": 1,
        "N_DRIVEN": 1,
    }
    events = count_bytes("event_memory", "events.h", sizes)
    sizes["event_memory"] = events
    sizes["energy_memory"] = energy = count_bytes("energy_memory", "energy.h", sizes)
    files = {"radau_work": "radau_work.h", "method_work": "explicit.h", "rk4_work": "rk4.h"}
    files |= {"rodas_memory": "rodas.h", "collocation_memory": "collocation.h"}
    expected = [events, energy, *(count_bytes(struct, file, sizes) for struct, file in files.items())]
    assert [int(word) for word in run_c(MAIN, tmp_path, *options_for(n, False)).split()] == expected


def test_a_constant_without_a_size_is_an_error() -> None:
    with pytest.raises(KeyError, match="N_MARGINS"):
        count_bytes("event_memory", "events.h", {"N_STATES": 6})
