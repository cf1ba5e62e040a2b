"""Ctrl-C ends the command line within a second, whatever it does, and leaves nothing behind."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.system.temporary_files import read_announcements, remove_leftovers
from tests.cases import thorough
from tests.codegen.compilers import is_running, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc")
COMMAND = [sys.executable, "-m", "tensegrity_codegen"]
PATIENCE = 60.0  # s; what is waited for takes a second, and the machine may be busy

# A worker that says that it is ready and then does what the first argument says.
WORKER = """
import signal, sys
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nohup ignores it
from tensegrity_codegen.cli.supervised import allow_interruption, run_supervised
def work():
    allow_interruption()
    try:
        print("ready", flush=True)
        exec(sys.argv[1])
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
run_supervised(work)
"""
SWALLOWING = """
import time
while True:
    try:
        while True:
            try:
                time.sleep(0.01)
            except:
                pass
    except:
        pass
"""
IN_C = "sum(range(10**13))"  # one call into C, which holds Python's lock for hours
LEAVING = """
from pathlib import Path
from tensegrity_codegen.system.files import replaced
from tensegrity_codegen.system.temporary_files import work_folder
with work_folder(Path(sys.argv[2])) as folder, replaced(Path(sys.argv[2]) / "a.txt", overwrite=False) as path:
    path.touch()
    (folder / "file").touch()
    print("written", flush=True)
    sum(range(10**13))
"""
PATIENT = """
import time
try:
    print("waiting", flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    print("cleaned up", flush=True)
    sys.exit(130)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Path:
    """The folder of a test, with nothing in it: what processes leave there is counted."""
    return tmp_path


def environment(**more: str) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | more


def start(code: str, *words: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WORKER, code, *map(str, words)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def interrupt(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Send Ctrl-C; return what was written after the process has ended, with 130."""
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    return out, err


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    path = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    return [int(word) for word in path.read_text(encoding="ascii").split()]


@pytest.mark.parametrize("code", [SWALLOWING, IN_C])
def test_work_that_does_not_hear_of_it_is_ended(code: str) -> None:
    process = start(code)
    (worker,) = workers_of(process)
    _, err = interrupt(process)
    assert err == "interrupted\n"
    wait_until(lambda: not is_running(worker), "the worker ended")


def test_work_that_hears_of_it_cleans_up_itself() -> None:
    process = start(PATIENT)
    assert process.stdout is not None
    assert process.stdout.readline() == "waiting\n"  # from here on the work catches Ctrl-C
    assert interrupt(process)[0] == "cleaned up\n"


def test_what_the_killed_worker_was_writing_is_removed(tmp_path: Path) -> None:
    process = start(LEAVING, tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline() == "written\n"
    assert len(list(tmp_path.iterdir())) == 2  # a folder and a file
    interrupt(process)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("code", ["sys.exit(7)", "sys.exit(0)", "raise ValueError"])
def test_the_exit_code_is_that_of_the_work(code: str) -> None:
    process = start(code)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == {"sys.exit(7)": 7, "sys.exit(0)": 0}.get(code, 1)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import atexit; atexit.register(print, 'handled'); print('done')", "done\nhandled\n"),
        ("import threading; threading.Timer(0.2, print, ('late',)).start()", "late\n"),
    ],
)
def test_exit_handlers_buffers_and_threads_come_to_their_end(code: str, said: str) -> None:
    process = start(f"{code}; sys.exit(3)")
    assert process.stdout is not None
    assert process.stdout.read() == said  # communicate() misses what was read with the first line
    process.communicate(timeout=PATIENCE)
    assert process.returncode == 3


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_are_passed_on(number: signal.Signals) -> None:
    process = start(SWALLOWING)
    (worker,) = workers_of(process)
    process.send_signal(number)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == -number
    assert not is_running(worker)


def test_a_worker_ends_with_the_process_that_waits_for_it() -> None:
    process = start(SWALLOWING)
    (worker,) = workers_of(process)
    process.kill()
    process.communicate(timeout=PATIENCE)
    wait_until(lambda: not is_running(worker), "the worker ended")


def descendants_of(process: int) -> list[int]:
    try:
        text = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii")
    except OSError:
        return []
    children = [int(word) for word in text.split()]
    return children + [item for child in children for item in descendants_of(child)]


class Build:
    """A build in an empty cache, in a process of its own, whose folders can be looked at."""

    def __init__(self, scene: str, folder: Path) -> None:
        self.work, self.cache, self.temporary = folder / "work", folder / "cache", folder / "temporary"
        for place in (self.work, self.temporary):
            place.mkdir()
        path = Path(__file__).parents[2] / "tensegrity_codegen" / "scene" / "examples" / f"{scene}.toml"
        quantities = ("-q", "state_jacobian", "-q", "acceleration") if scene == "tower" else ()
        self.command = [*COMMAND, "build", str(path), *quantities, "--out", "made", "--json"]
        self.environment = environment(TMPDIR=str(self.temporary), **{CACHE_VARIABLE: str(self.cache)})
        self.process = self.start()
        wait_until(lambda: self.has_ended or bool(workers_of(self.process)), "the worker started")

    def start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            self.command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self.work,
            env=self.environment,
        )

    @property
    def has_ended(self) -> bool:
        return self.process.poll() is not None

    def compiles(self) -> bool:
        """Whether a compiler runs below the worker."""
        return len(descendants_of(self.process.pid)) > 1

    def wait_for(self, phase: str) -> None:
        """Wait until a phase has begun, or as many seconds as `phase` says; the build may end before."""
        if phase == "compilation":
            wait_until(lambda: self.compiles() or self.has_ended, "a compiler runs", PATIENCE)
        elif phase != "start":
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(float(phase))

    def left(self) -> list[str]:
        """Return what is left of work that was not finished."""
        places = (self.temporary.iterdir(), self.cache.glob("temporary/*"))
        return [path.name for paths in places for path in paths]


# Seconds from the start of the worker go from the first import over emission to compilation.
@pytest.mark.parametrize("phase", ["compilation", *thorough("start", "0.15", "0.4", "0.8")])
def test_ctrl_c_in_every_phase_of_a_build(phase: str, tmp_path: Path) -> None:
    build = Build("tower", tmp_path)
    build.wait_for(phase)
    assert not build.has_ended  # compiling the tower takes several seconds
    assert interrupt(build.process)[0] == ""
    assert list(build.work.iterdir()) == []
    wait_until(lambda: build.left() == [], "nothing is left among the temporary files")
    assert list(build.cache.glob("libraries/*")) == []


def test_advice_is_the_last_one_that_was_announced() -> None:
    known: set[str] = set()
    advice: list[str | None] = []
    assert read_announcements(b"+/a\0?go on with a\0?go on with b\0", known, advice) == b""
    assert (known, advice) == ({"/a"}, ["go on with b"])
    read_announcements(b"?\0", known, advice)
    assert (known, advice) == ({"/a"}, [])
    read_announcements(b"?go on\0!\0", known, advice)
    assert advice == [None]  # the process has said it


def test_announcements_come_in_pieces(tmp_path: Path) -> None:
    known: set[str] = set()
    rest = b""
    for piece in (b"+/a\0+/b", b"c\0-/a", b"\0"):
        rest = read_announcements(rest + piece, known)
    assert (rest, known) == (b"", {"/bc"})
    (tmp_path / "kept").touch()
    (tmp_path / "link").symlink_to("kept")
    remove_leftovers({str(tmp_path / "link"), str(tmp_path / "missing")})
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


@pytest.mark.parametrize("phase", ["compilation", *thorough("0.1", "0.7", "2.5")])
def test_killed_in_any_phase_of_a_build_the_next_one_heals(phase: str, tmp_path: Path) -> None:
    build = Build("two_nodes", tmp_path)
    build.wait_for(phase)
    if not build.has_ended:
        worker, *rest = descendants_of(build.process.pid)
        os.kill(worker, signal.SIGKILL)
        build.process.kill()
        wait_until(lambda: not any(map(is_running, [worker, *rest])), "the compilers ended")
    build.process.communicate(timeout=PATIENCE)
    again = build.start()
    _, err = again.communicate(timeout=120.0)
    assert again.returncode == 0, err
    assert (build.work / "made" / "two_nodes.h").is_file()
    assert [path.name for path in build.work.iterdir()] == ["made"]
    assert build.left() == []
