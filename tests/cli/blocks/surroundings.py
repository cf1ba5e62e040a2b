"""What pages presuppose: files, names of Python, declarations of C; and the few blocks that are not run."""

import json

from tests.scene.formats.test_import_ansys import TEXT as ANSYS
from tests.scene.formats.test_import_compas import EDGES, NODES
from tests.scene.formats.test_import_gltf import LINES
from tests.scene.formats.test_import_mjcf import TEXT as MJCF
from tests.scene.formats.test_import_ntrt import PAIR, STICK
from tests.scene.formats.test_import_tdf import TEXT as TDF

# The least that a drawing has: one line on a layer.
DRAWING = "0 SECTION 2 ENTITIES 0 LINE 8 net 10 0.0 20 0.0 30 0.0 11 1.0 21 0.0 31 0.0 0 ENDSEC 0 EOF "

# Pages whose blocks another test runs, and that test.
ELSEWHERE = {
    "docs/languages/": "tests/examples",
    "docs/scene.md": "tests/test_house.py",
}

SCENE_JSON = json.dumps(
    {
        "format": "tensegrity_codegen scene 1",
        "name": "cord",
        "nodes": {"a": {"position": [0, 0, 0], "anchored": True}, "b": {"position": [1, 0, 0], "mass": 1}},
        "members": {"m": {"kind": "cable", "nodes": ["a", "b"], "axial_stiffness": 10.0}},
    }
)

STEPPING = '#include <stdio.h>\n#include <string.h>\n#include "prism12.h"'

# Blocks that no test runs: page, beginning, reason.
EXCLUDED = (
    ("README.md", "make demo", "verbs of this repository's Makefile; they run these tests"),
    ("README.md", "pip install", "installs packages, from a network"),
    ("CONTRIBUTING.md", "make setup", "verbs of this repository's Makefile; they run these tests"),
    ("examples/README.md", "make examples", "tests/examples run the programs"),
    ("docs/start.md", "python -m venv", "installs packages, from a network"),
    ("docs/sweep.md", "dask scheduler", "needs several machines; tests/sweeps runs a cluster of processes"),
    ("docs/sweep.md", "from dask_jobqueue", "needs a cluster with SLURM"),
    (
        "docs/gains.md",
        "from tensegrity_codegen import read_profile",
        "takes minutes; tests/control/feedback/test_time_motion.py runs a part of it",
    ),
    ("docs/integrating_in_c.md", "integrators = ", "one line; tests/codegen/test_profiles_in_c.py has it"),
    ("docs/integrating_in_c.md", "events = ", "one line; tests/codegen/integrators/test_events.py has it"),
    ("docs/integrating_in_c.md", STEPPING, "tests/codegen/test_profiles_in_c.py runs the program"),
    (
        "docs/integrating_in_c.md",
        "cc -std=c99 -O2 -o stepping",
        "tests/codegen/test_profiles_in_c.py runs it",
    ),
    ("docs/learning.md", "import jax", "needs JAX; tests/learning/derivatives/test_page.py runs it"),
    ("docs/learning.md", "import torch", "needs PyTorch; tests/learning/derivatives/test_page.py runs it"),
    ("docs/build_a_robot.md", "python tensegrity_codegen", "takes minutes; tests/learning/test_rolling.py"),
    ("docs/coming_from/compas.md", "from jax_fdm", "needs jax_fdm; the block behind it has the same result"),
    ("docs/machines.md", "arm-none-eabi-gcc", "needs that compiler; tests/codegen compile for it by zig"),
    ("docs/machines.md", "import { readFileSync }", "tests/codegen/test_other_machines.py runs it in node"),
    (
        "docs/export.md",
        "tensegrity-codegen export acados",
        "needs acados; tests/cli/test_control.py writes its project",
    ),
    ("docs/fmu.md", "cc -std=c99", "in the sources of an FMU; tests/export compile them"),
    ("docs/guides/trust.md", "tensegrity-codegen stability", "takes minutes; tests/studies run smaller ones"),
    (
        "docs/reproduction.md",
        "tensegrity-codegen reproduce",
        "takes minutes; tests/studies/papers has its parts",
    ),
    ("docs/gallery/ntrt_prism.md", "tensegrity-codegen import", "needs a file of the toolkit"),
    ("docs/gallery/superball.md", "tensegrity-codegen import", "needs a file of the toolkit"),
    ("docs/gallery/spine.md", "tensegrity-codegen import", "needs a file of the toolkit"),
)

# Commands that end with another code than 0, as their page says.
EXITS = {
    "tensegrity-codegen plan prism12.toml --to twist=165 --actuate v1 --actuate v2 --actuate v3": 3,
    "tensegrity-codegen stand standing.toml --load t1=5,0,0": 3,
}

# Example scenes that a page presupposes in the folder; pages of the gallery presuppose their own.
SCENES = {
    "README.md": ("prism",),
    "docs/casadi_functions.md": ("prism",),
    "docs/derivatives.md": ("prism",),
    "docs/embedding.md": ("prism",),
    "docs/export.md": ("prism", "pinned_prism"),
    "docs/fmu.md": ("prism",),
    "docs/integrating_in_c.md": ("prism", "prism12", "pinned_prism"),
    "docs/learning.md": ("pinned_prism",),
    "docs/live.md": ("prism",),
    "docs/machines.md": ("prism",),
    "docs/pictures.md": ("prism",),
    "docs/python.md": ("prism",),
    "docs/sweep.md": ("prism", "pinned_prism"),
}

# Other files that a page presupposes.
FILES = {
    "docs/import.md": {
        "nodes.csv": "node,x,y,z,mass,anchored\na,0,0,0,,yes\nb,1,0,0,1,no\n",
        "members.csv": "member,kind,node_i,node_j,axial_stiffness\nm,cable,a,b,1e4\n",
        "structure.yaml": PAIR,
        "stick.yaml": STICK,
        "scene.json": SCENE_JSON,
        "network.json": json.dumps({"node": NODES, "edge": EDGES}),
        "structure_ansys.txt": ANSYS,
        "structure.tdf.xml": TDF,
        "model.xml": MJCF,
        "lines.dxf": DRAWING.replace(" ", "\n"),
        "lines.glb": json.dumps(LINES),
    },
}

# Python before a block, which names what the page takes as known: page, beginning of the block, code.
BEFORE = (
    (
        "docs/integrating_in_c.md",
        "coordinate = model.nominal",
        "import numpy as np\nfrom tensegrity_codegen import compile_scene, simulate_batch\n"
        'rng = np.random.default_rng(0)\nmodel = compile_scene("prism.toml", for_=("simulate_batch",))\n',
    ),
    (
        "docs/casadi_functions.md",
        "from dataclasses",
        "from pathlib import Path\n"
        'text = Path("prism.toml").read_text().replace(\'anchor_bottom = "z"\', "anchor_bottom = true")\n'
        'Path("held.toml").write_text(text)\n',
    ),
)

COORDINATE = "double coordinate[PRISM_N_COORDINATES] = {0};"
# What stands before the pieces of C of a page, in the function in which they are compiled and run.
C_BEFORE = {
    "docs/embedding.md": f"{COORDINATE} double displacement[PRISM_N_COORDINATES] = {{0}};",
    "docs/integrating_in_c.md": "",
}
C_HEAD = "#include <stdio.h>\n#include <string.h>\n"
