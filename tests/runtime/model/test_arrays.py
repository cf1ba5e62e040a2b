"""Arrays in .npz files that may come from anyone: only what is needed is read, whatever the file declares."""

import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.runtime.model import arrays
from tensegrity_codegen.runtime.model.arrays import read_arrays, read_names, write_arrays


def write_zeros(path: Path, name: str, count: int) -> None:
    """Add an array of zeros to an archive, which takes a thousandth of its memory there."""
    header = {"descr": "<f8", "fortran_order": False, "shape": (count,)}
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open(f"{name}.npy", "w") as file,
    ):
        np.lib.format.write_array_header_1_0(file, header)
        file.write(bytes(8 * count))


def test_arrays_that_nobody_asked_for_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    write_arrays(path, {"x": np.arange(3.0), "y": np.ones(2)}, overwrite=False)
    write_zeros(path, "more", 4 * 2**20)
    tracemalloc.start()
    found = read_arrays(path, ("x", "z"))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert list(found) == ["x"]
    assert found["x"].tolist() == [0.0, 1.0, 2.0]
    assert peak < 2**20
    assert read_names(path) == ("x", "y", "more")
    assert read_arrays(path)["more"].shape == (4 * 2**20,)


def test_compressed_arrays_that_take_too_much_memory_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npz"
    monkeypatch.setattr(arrays, "MAX_UNPACKED", 2**20)
    write_zeros(path, "x", 2**18)
    with pytest.raises(ValueError, match="compressed arrays of 2 MB; up to 1 MB are read"):
        read_arrays(path, ("x",))
    np.savez(tmp_path / "stored.npz", x=np.zeros(2**18))  # which takes as much on the disk
    assert read_arrays(tmp_path / "stored.npz", ("x",))["x"].shape == (2**18,)
