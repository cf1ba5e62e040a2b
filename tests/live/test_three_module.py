"""Where three.js is taken from: a named file, this package, the cache; another file is refused."""

import hashlib
from pathlib import Path

import pytest

from tensegrity_codegen.live import three_module
from tensegrity_codegen.live.three_module import (
    BUNDLED,
    THREE_VARIABLE,
    describe_three,
    find_three,
    read_bundled,
)
from tensegrity_codegen.system.errors import MissingSourceError

MODULE = "export const THREE = {};\n"


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in the place of the one in this package, with a module and its licences."""
    folder = tmp_path / "three"
    folder.mkdir()
    for name, text in zip(BUNDLED, (MODULE, "MIT"), strict=True):
        (folder / name).write_bytes(text.encode())
    monkeypatch.setattr(three_module, "bundle_folder", lambda: folder)
    monkeypatch.setattr(three_module, "MODULE_SHA256", hashlib.sha256(MODULE.encode()).hexdigest())
    monkeypatch.delenv(THREE_VARIABLE, raising=False)
    return folder


def test_the_module_in_the_package_needs_no_network(bundle: Path) -> None:
    assert find_three() == (MODULE, "MIT")
    assert describe_three() == (True, "in this package")


@pytest.mark.parametrize("name", BUNDLED)
def test_a_damaged_or_incomplete_bundle_is_not_used(bundle: Path, name: str) -> None:
    if name == BUNDLED[0]:
        (bundle / name).write_text(MODULE + "attack()")
    else:
        (bundle / name).unlink()
    assert read_bundled() is None
    assert describe_three()[1] != "in this package"


def test_a_named_file_comes_first_and_another_file_is_refused(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other.whl"
    other.write_bytes(b"no wheel")
    with pytest.raises(MissingSourceError, match="this is not") as caught:
        find_three(other)
    assert "`three=PATH`" in caught.value.hint
    monkeypatch.setenv(THREE_VARIABLE, str(other))
    with pytest.raises(MissingSourceError, match="this is not"):
        find_three()
    assert describe_three() == (True, f"{THREE_VARIABLE}={other}")
    monkeypatch.setenv(THREE_VARIABLE, str(tmp_path / "none.whl"))
    with pytest.raises(MissingSourceError, match="cannot be read"):
        find_three()
    assert not describe_three()[0]


def test_without_any_copy_the_option_is_named(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (bundle / BUNDLED[0]).unlink()
    empty = tmp_path / "cache"
    empty.mkdir(mode=0o700)
    monkeypatch.setenv("TENSEGRITY_CODEGEN_CACHE", str(empty))
    is_here, where = describe_three()
    assert not is_here
    assert "`three=PATH`" in where
