"""Live pages of the gallery's scenes, and copies of the scene files, written beside the pages of the site."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from site_pages.gallery import find_scenes
from site_pages.links import ROOT

# What a live page is made by: the package, its templates.
SOURCES = (ROOT / "tensegrity_codegen", ROOT / "templates")
# Scenes that begin as stated, out of equilibrium, since their motion is the point; the others begin settled.
MOVING = (
    *("two_nodes", "icosahedron", "savin_prism", "superball_drop"),
    *("icosahedron_gait", "icosahedron_roll", "three_rods", "crawling_spine"),
)
# Scenes whose shape is found in the page, with the force densities where its sliders begin.
FORMED = {"cable_net": ("edge=20000", "sagging=3000", "hogging=3000")}

# Scenes that no page can run: their pages show a recorded motion, of so long [s] and with so many samples.
RECORDED = {"braced_frame": ("1", "501")}


def write_live_pages(site: Path, cache: Path) -> list[str]:
    """Write the live page of each scene whose inputs have changed; return the names that failed.

    `cache` is a file with the fingerprint of the inputs of each page that was written before.
    """
    for folder in ("live", "scenes"):
        (site / folder).mkdir(parents=True, exist_ok=True)
    known = json.loads(cache.read_text(encoding="utf-8")) if cache.exists() else {}
    code_mark = _hash_files([path for folder in SOURCES for path in _list_files(folder)])
    scenes = find_scenes()
    wanted = {name: compute_fingerprint(path, code_mark, _list_words(name)) for name, path in scenes.items()}
    due = [name for name in scenes if wanted[name] != known.get(name) or not _page(site, name).exists()]
    print(f"live pages: {len(due)} of {len(scenes)} have to be written", file=sys.stderr)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        codes = list(pool.map(lambda name: _write_page(scenes[name], _page(site, name)), due))
    for path in scenes.values():
        shutil.copyfile(path, site / "scenes" / path.name)
    failed = [name for name, code in zip(due, codes, strict=True) if code != 0]
    done = {name: mark for name, mark in wanted.items() if name not in failed}
    cache.write_text(json.dumps(done, indent=1), encoding="utf-8")
    return failed


def compute_fingerprint(scene: Path, code: str, words: Sequence[str]) -> str:
    """Return a hash of all that a live page follows from: scene, its inputs, code, words of the command."""
    profile = scene.with_suffix(".csv")
    inputs = profile.read_bytes() if profile.exists() else b""
    parts = [scene.read_bytes(), inputs, code.encode(), " ".join(words).encode()]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def _page(site: Path, name: str) -> Path:
    return site / "live" / f"{name}.html"


def _list_words(name: str) -> list[str]:
    if name in FORMED:
        return ["form", *(word for density in FORMED[name] for word in ("--density", density))]
    if name in RECORDED:
        return ["show"]
    return ["play", *([] if name in MOVING else ["--settle"])]


def _write_page(scene: Path, page: Path) -> int:
    verb, *options = _list_words(scene.stem)
    command = [verb, str(scene), *options, "--out", str(page), "--overwrite"]
    profile = scene.with_suffix(".csv")  # inputs over time, beside a scene that has any
    command += ["--profile", str(profile)] if profile.exists() else []
    with tempfile.TemporaryDirectory() as folder:
        if scene.stem in RECORDED:
            end, samples = RECORDED[scene.stem]
            motion = str(Path(folder) / "motion.npz")
            _run(["simulate", str(scene), "--t-end", end, "--samples", samples, "--out", motion])
            command += ["--trajectory", motion]
        done = _run(command)
    print(f"{scene.stem}: {done.stdout.strip() or done.stderr.strip()}", file=sys.stderr)
    return done.returncode


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tensegrity_codegen", *command], check=False, capture_output=True, text=True
    )


def _list_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)


def _hash_files(paths: Sequence[Path]) -> str:
    whole = hashlib.sha256()
    for path in paths:
        whole.update(f"{path.relative_to(ROOT)}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return whole.hexdigest()
