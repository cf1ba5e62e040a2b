"""Damage of any file of a sweep: it is refused by name or computed again, and no wrong number is read."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.sweeps.engines.engine import LocalEngine
from tensegrity_codegen.sweeps.run import SweepOutcome, run_sweep
from tensegrity_codegen.sweeps.store.folder import ATTRIBUTE, compute_checksum, open_sweep
from tensegrity_codegen.sweeps.store.table import write_sweep_table
from tensegrity_codegen.sweeps.summary.results import read_results
from tensegrity_codegen.system.errors import OutputError
from tensegrity_codegen.system.forked import can_fork
from tests.cases import thorough
from tests.sweeps.engines.conftest import NoLibraries, Square, make_work

pytest.importorskip("zarr", reason="Zarr is missing: pip install '.[sweep]'")
pytest.importorskip("xarray", reason="xarray is missing: pip install '.[sweep]'")
pytestmark = pytest.mark.skipif(not can_fork(), reason="these tests need a system that forks processes")


def compute(out: Path) -> SweepOutcome:
    engine = LocalEngine(1, NoLibraries())  # type: ignore[arg-type]
    return run_sweep(make_work(Square(), count=24, wrong=7.0), out, engine, identity={"scene": {}}, facts={})


def flip_bit(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 4
    file.write_bytes(data)


def replace_by_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def replace_by_loop(file: Path) -> None:
    """A file that the system refuses to read."""
    file.unlink()
    file.symlink_to(file.name)


DAMAGE: tuple[Callable[[Path], object], ...] = (
    Path.unlink,
    lambda file: file.write_bytes(b""),
    lambda file: file.write_bytes(file.read_bytes()[: file.stat().st_size // 2]),
    flip_bit,
    replace_by_folder,
    replace_by_loop,
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sweep") / "whole.zarr"
    compute(path)
    return path


OTHERS = ("x/zarr.json", "square/zarr.json", "status/c/1", "message/c/1", "task_record/c/1")


@pytest.mark.parametrize("name", ["zarr.json", "x/c/0", "square/c/1", *thorough(*OTHERS)])
def test_no_damage_leads_to_wrong_numbers(whole: Path, tmp_path: Path, name: str) -> None:
    expected = open_sweep(whole)
    for damage in DAMAGE:
        path = tmp_path / "a.zarr"
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(whole, path)
        damage(path / name)
        try:
            assert open_sweep(path).identical(expected)
        except OutputError as error:
            text = str(error)
            for read in (read_results, lambda path: write_sweep_table(path, tmp_path / "a.csv")):
                with pytest.raises(OutputError) as caught:
                    read(path)
                assert str(caught.value) == text
        try:
            outcome = compute(path)
        except OutputError:
            assert name == "zarr.json" or damage is replace_by_folder
            continue
        assert outcome.counts == {"bad_input": 1, "ok": 23}
        assert outcome.computed == (8 if name.endswith("/1") else 0)
        assert open_sweep(path).identical(expected)


def test_what_is_damaged_is_named_and_computed_again(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    shutil.copytree(whole, path)
    (path / "square/c/1").unlink()
    flip_bit(path / "status/c/2")
    with pytest.raises(OutputError, match="damaged or missing") as caught:
        open_sweep(path)
    assert caught.value.given == "square/c/1, status/c/2"
    assert "run the same sweep again" in str(caught.value)
    outcome = compute(path)
    assert (outcome.computed, outcome.damaged) == (16, 16)
    assert np.array_equal(open_sweep(path)["square"], open_sweep(whole)["square"], equal_nan=True)
    assert compute(path).computed == 0


def write_chunk(file: Path, content: bytes) -> None:
    """Write a chunk with the right checksum."""
    checksum = pytest.importorskip("google_crc32c").value(content)
    file.write_bytes(content + checksum.to_bytes(4, "little"))


def test_a_chunk_is_expanded_only_to_the_size_of_what_was_written(whole: Path, tmp_path: Path) -> None:
    numcodecs = pytest.importorskip("numcodecs")
    expected = open_sweep(whole).load()
    large = bytes(numcodecs.zstd.compress(bytes(2**24), 1))
    header = large[:4] + b"\xe0" + (2**40).to_bytes(8, "little") + large[13:]  # of a terabyte
    short = bytes(numcodecs.zstd.compress((10**6).to_bytes(4, "little") + bytes(40), 1))
    numbers = bytes(numcodecs.blosc.compress(bytes(2**20), b"lz4", 5))
    broken = numbers[:4] + (64).to_bytes(4, "little") + numbers[8:]
    for name in ("message/c/1", "square/c/1", "status/c/1"):
        for content in (large, header, short, numbers, broken, b"\x28\xb5\x2f\xfd"):
            path = tmp_path / "a.zarr"
            shutil.rmtree(path, ignore_errors=True)
            shutil.copytree(whole, path)
            write_chunk(path / name, content)
            for read in (open_sweep, read_results):
                with pytest.raises(OutputError) as caught:
                    read(path)
                assert caught.value.given == name
    compute(path)
    assert open_sweep(path).load().identical(expected)


@pytest.mark.parametrize(
    ("array", "key", "value"),
    [
        ("x", "shape", [10**12]),
        ("x", "shape", [-1]),
        ("status", "chunk_grid", {"configuration": {"chunk_shape": [0]}}),
        ("square", "codecs", [{"name": "bytes"}, {"name": "gzip"}, {"name": "crc32c"}]),
        ("square", "data_type", "string"),
        ("square", "shape", None),
    ],
)
def test_arrays_that_no_sweep_writes_are_refused(
    array: str, key: str, value: object, whole: Path, tmp_path: Path
) -> None:
    path = tmp_path / "a.zarr"
    shutil.copytree(whole, path)
    data = json.loads((path / "zarr.json").read_bytes())
    data["consolidated_metadata"]["metadata"][array][key] = value
    data["attributes"][ATTRIBUTE]["checksum"] = compute_checksum(data)
    (path / "zarr.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(OutputError, match=r"not a sweep: zarr\.json is damaged or of another program"):
        open_sweep(path)
