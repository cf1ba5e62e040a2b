"""Files of the cache are compared with their hashes before they are copied."""

from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.cache import read_contents, read_entry, write_entry
from tensegrity_codegen.system.errors import LibraryError

KEY = "a" * 64
FILES = {"prism.c": b"int prism;\n", "manifest.json": b"{}\n", "libprism.so": b"library"}


def test_the_contents_are_what_was_written(tmp_path: Path) -> None:
    write_entry(tmp_path / KEY, FILES)
    entry = read_entry(tmp_path / KEY, KEY)
    assert entry is not None
    assert read_contents(entry) == FILES


def test_an_entry_nested_beyond_reason_is_absent(tmp_path: Path) -> None:
    write_entry(tmp_path / KEY, FILES)
    (tmp_path / KEY / "entry.json").write_text("[" * 200_000, encoding="utf-8")
    assert read_entry(tmp_path / KEY, KEY) is None


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("is_gone", [False, True])
def test_a_file_that_was_changed_is_not_copied(name: str, is_gone: bool, tmp_path: Path) -> None:
    write_entry(tmp_path / KEY, FILES)
    entry = read_entry(tmp_path / KEY, KEY)
    assert entry is not None
    path = entry.folder / name
    if is_gone:
        path.unlink()
    else:
        path.write_bytes(bytes(reversed(FILES[name])))  # of the same size
    with pytest.raises(LibraryError, match="not what was written there") as caught:
        read_contents(entry)
    assert name in str(caught.value.given)
