"""The verb `cache`, and where the cache is."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.system.errors import UnsafeCacheError
from tests.cli.conftest import Run
from tests.codegen.compilers import POSIX

KEY = "a" * 64
FILES = {"manifest.json": b"{}", "libprism.so": b"library"}
NOBODY = 65534
ROOT_ONLY = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root may act as another user"
)


@pytest.fixture
def place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of this test alone, which does not exist yet."""
    monkeypatch.setenv(CACHE_VARIABLE, str(folder / "cache"))
    return folder / "cache"


def test_it_says_where_how_many_and_how_large(run: Run, place: Path, two_nodes: Path) -> None:
    empty = run("cache", "--json").data
    assert (empty["folder"], empty["entries"], empty["bytes"]) == (str(place), 0, 0)
    assert not place.exists()
    size = Path(run("build", two_nodes, "--json").data["library"]).stat().st_size
    data = run("cache", "--json").data
    assert data["entries"] == 1
    assert size < data["bytes"] < data["limit_bytes"]
    assert "1 library," in run("cache").out


@pytest.mark.thorough
def test_clear_removes_all_and_the_next_build_works(run: Run, place: Path, two_nodes: Path) -> None:
    run("build", two_nodes, "--json")
    size = run("cache", "--json").data["bytes"]
    data = run("cache", "--clear", "--json").data
    assert (data["removed_entries"], data["freed_bytes"], data["entries"]) == (1, size, 0)
    assert list((place / "libraries").iterdir()) == []
    assert list((place / "requests").iterdir()) == []
    assert run("build", two_nodes, "--json").data["from_cache"] is False


@POSIX
def test_a_cache_that_others_may_write_is_refused_by_every_verb(
    run: Run, place: Path, two_nodes: Path
) -> None:
    run("build", two_nodes)
    place.chmod(0o777)
    for words in (("cache",), ("cache", "--clear"), ("build", two_nodes), ("equilibrium", two_nodes)):
        ended = run.refused(*words, "--json")
        assert ended.data["error"] == "UnsafeCacheError"
        assert ended.data["where"] == str(place)
        assert CACHE_VARIABLE in ended.data["hint"]
    ended = run.refused("doctor", "--json")
    assert "another user" in " ".join(ended.data["problems"])


def act_as_nobody(what: str, root: Path) -> str:
    """Plant or find a library as the user nobody, in a child process; return what came of it."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        answer = "died"
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            cache = Cache(root)
            answer = str(cache.store(KEY, FILES) if what == "store" else cache.find(KEY))
        except UnsafeCacheError as error:
            answer = f"refused: {error.given}"
        finally:
            os.write(writing, answer.encode("utf-8"))
            os._exit(0)
    os.close(writing)
    os.waitpid(child, 0)
    with os.fdopen(reading, "rb") as pipe:
        return pipe.read().decode("utf-8")


@POSIX
@ROOT_ONLY
def test_neither_of_two_users_runs_the_library_of_the_other(
    run: Run, monkeypatch: pytest.MonkeyPatch, two_nodes: Path
) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        shared = Path(name)
        shared.chmod(0o1777)
        assert KEY in act_as_nobody("store", shared / "theirs")
        with pytest.raises(UnsafeCacheError) as caught:
            Cache(shared / "theirs").find(KEY)
        assert f"user {NOBODY}" in str(caught.value.given)
        monkeypatch.setenv(CACHE_VARIABLE, str(shared / "theirs"))
        ended = run("build", two_nodes, "--json")
        assert (ended.code, ended.data["error"]) == (2, "UnsafeCacheError")
        Cache(shared / "ours").store(KEY, FILES)
        assert act_as_nobody("find", shared / "ours").startswith("refused: it belongs to user 0")


# Builds as a user whose home may not be written to.
WITHOUT_HOME = """
import os, sys
real = os.access
os.access = lambda path, mode, **more: False if os.fspath(path) == sys.argv[1] else real(path, mode, **more)
from tensegrity_codegen.cli.app import main
main(sys.argv[2:])
"""


@pytest.mark.thorough
@POSIX
def test_a_home_that_cannot_be_written_is_no_obstacle(folder: Path, two_nodes: Path) -> None:
    home, temporary = folder / "home", folder / "tmp"
    home.mkdir()
    temporary.mkdir()
    environment = {key: value for key, value in os.environ.items() if key != CACHE_VARIABLE}
    environment |= {
        "XDG_CACHE_HOME": str(home),
        "TMPDIR": str(temporary),
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    for from_cache in (False, True):
        ended = subprocess.run(
            [sys.executable, "-c", WITHOUT_HOME, str(home), "build", two_nodes.name, "--json"],
            capture_output=True,
            text=True,
            env=environment,
            timeout=120,
        )
        assert ended.returncode == 0, ended.stderr
        data = json.loads(ended.stdout)
        assert data["from_cache"] is from_cache
        assert Path(data["library"]).is_relative_to(temporary)
        assert ended.stderr.count("warning:") == 1
        assert CACHE_VARIABLE in ended.stderr
    assert list(home.iterdir()) == []
