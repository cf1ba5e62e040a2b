"""What leaving out saves: one prism asked in six ways, each asking for more than the one before.

python benchmarks/leaving_out.py
"""

import statistics
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tensegrity_codegen.codegen.compilation.compile import object_size
from tensegrity_codegen.codegen.compilation.flags import FLAG_SETS
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.measure import time_functions
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest

SCENE = {
    "name": "prism",
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 2e5},
        "cable": {"kind": "cable", "spring_constant": 200.0, "tension_only": False},
    },
    "shape": {
        "kind": "prism",
        "bars": 3,
        "bottom_radius": 0.15,
        "top_radius": 0.12,
        "height": 0.3,
        "node_mass": 0.05,
        "prestress": 10.0,
    },
}
TURNS = 9
WANTED = ("member_tension", "acceleration", "total_energy")


def ways() -> list[tuple[str, Structure, ModelRequest]]:
    """Return the six ways: name, structure, request."""
    bare, _ = assemble(parse_scene(SCENE))
    request = ModelRequest(WANTED)
    gravity = bare.with_changes(gravity=np.array([0.0, 0.0, -9.81]))
    damped = gravity.with_changes(damping=np.full(bare.n_members, 0.5))
    slack = damped.with_changes(tension_only=~bare.is_bar)
    load = np.zeros((bare.n_nodes, 3))
    load[3:] = [1.0, 2.0, -3.0]
    loaded = slack.with_changes(node_load=load)
    parameters = {
        "rest_length": tuple(range(bare.n_members)),
        "spring_constant": tuple(range(bare.n_members)),
        "damping": tuple(range(bare.n_members)),
        "node_mass": tuple(range(bare.n_nodes)),
        "node_load": tuple(range(bare.n_nodes)),
        "gravity": (),
    }
    full = replace(request, parameters=parameters, integrators=("rk4",))
    full = replace(full, quantities=offered(build_model(loaded, full)))
    return [
        ("bare", bare, request),
        ("+ gravity", gravity, request),
        ("+ damping", damped, request),
        ("+ slack", slack, request),
        ("+ loads", loaded, request),
        ("everything", loaded, full),
    ]


def offered(model: SymbolicModel) -> tuple[str, ...]:
    """Return the quantities that have an entry in this model."""
    names = []
    for name in model.quantities:
        with suppress(FormulationError):
            names += [name] if model.expression(name).nnz() else []
    return tuple(names)


def main() -> None:
    """Print the table."""
    compiler, flags = find_compiler(), FLAG_SETS["reference"]
    sources = {title: emit(structure, request) for title, structure, request in ways()}
    # The ways take turns, so that a slow moment of the machine does not fall on one of them alone.
    turns = [
        {title: time_functions(source, compiler, flags) for title, source in sources.items()}
        for _ in range(TURNS)
    ]
    print(f"{compiler.version}, {' '.join(flags.options)}; ns a call: medians of {TURNS} turns\n")
    print(
        f"| asked | functions | arguments | operations | object bytes | ns {' | ns '.join(WANTED)} | ns sum |"
    )
    print("|---" * 9 + "|")
    for title, source in sources.items():
        functions = source.manifest.functions
        ns = {name: statistics.median(turn[title][name] for turn in turns) for name in WANTED}
        code = {name: source.files[name] for name in ("prism.c", "prism.h")}
        row = [
            title,
            len(functions),
            sum(len(spec.arguments) for spec in functions),
            sum(spec.operations for spec in functions),
            object_size(code, compiler=compiler, flags=flags),
            *(f"{ns[name]:.1f}" for name in WANTED),
            f"{sum(ns.values()):.1f}",
        ]
        print("| " + " | ".join(str(cell) for cell in row) + " |")


if __name__ == "__main__":
    main()
