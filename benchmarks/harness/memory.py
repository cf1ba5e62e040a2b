"""The peak memory of a process and all of its descendants together, looked at while they run."""

import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

INTERVAL = 0.03  # s from one look to the next
PROC = Path("/proc")


class Watched(subprocess.CompletedProcess[str]):
    """How a command ended; peak: of all its processes together [byte], None where unknown."""

    peak: int | None = None


def run_watched(command: Sequence[str], timeout: float) -> Watched:
    """Run a command as subprocess.run does with captured text; raises TimeoutExpired.

    Resident sets are added up, so memory that processes share counts for each of them: an upper bound. The
    peak that a child reports of itself would not do: it starts at what its parent held.
    """
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        peaks, ended = [0], threading.Event()
        watcher = threading.Thread(target=_watch, args=(process.pid, ended, peaks))
        watcher.start()
        try:
            output, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            ended.set()
            watcher.join()
    done = Watched(command, process.returncode, output, errors)
    done.peak = peaks[0] or None
    return done


def _watch(pid: int, ended: threading.Event, peaks: list[int]) -> None:
    while not ended.wait(INTERVAL):
        started = time.perf_counter()
        peaks[0] = max(peaks[0], _resident(pid))
        time.sleep(min(1.0, 5 * (time.perf_counter() - started)))  # where there are many processes


def _resident(pid: int) -> int:
    """Return the resident sets of a process and its descendants [byte], 0 where the system does not tell."""
    family, size = {pid}, 0
    parents = _read_parents()
    found = family
    while found:
        found = {child for child, parent in parents.items() if parent in found}
        family |= found
    for member in family:
        try:
            text = (PROC / str(member) / "status").read_text(encoding="utf-8", errors="replace")
        except OSError:  # it has ended
            continue
        size += next((int(line.split()[1]) for line in text.splitlines() if line.startswith("VmRSS:")), 0)
    return size * 1024


def _read_parents() -> Mapping[int, int]:
    """Return process -> its parent."""
    parents: dict[int, int] = {}
    for entry in PROC.glob("[0-9]*/stat"):
        try:
            text = entry.read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        # The command's name, in brackets, may hold blanks and brackets itself.
        parents[int(entry.parent.name)] = int(text.rpartition(")")[2].split()[1])
    return parents
