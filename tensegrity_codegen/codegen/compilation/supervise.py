"""The parent of one compiler run on POSIX: sets its limits, watches it, reports on it, cleans up after it.

A script, run as `python -I -S supervise.py SECONDS BYTES COMMAND...`, never imported by the package. Being a
process of its own, it sets limits without `preexec_fn` (which is unsafe when other threads run) and measures
the peak memory of the command alone. The command runs in its own process group, with standard input and
limits as below, and the group is killed as soon as
  - SECONDS have passed, or
  - standard input of this script reaches its end (whoever started it is gone), or
  - SIGTERM comes (whoever started it gave up).
BYTES (0: no limit) bounds the address space of each process of the command. Both output streams of the
command go to standard error of this script; standard output gets one line when all is over:
    exit | signal | time,  its number,  seconds,  peak resident memory in bytes
"""

import contextlib
import os
import resource
import select
import signal
import sys
import time

CANNOT_START = 127


def main(arguments: list[str]) -> None:
    """Run the command in `arguments` (SECONDS, BYTES, COMMAND...) and print the report."""
    seconds, memory_limit, command = float(arguments[0]), int(arguments[1]), arguments[2:]
    wake_read, wake_write = os.pipe()
    os.set_blocking(wake_write, False)
    signal.set_wakeup_fd(wake_write, warn_on_full_buffer=False)
    for watched in (signal.SIGCHLD, signal.SIGTERM):
        signal.signal(watched, lambda number, frame: None)
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        _start_command(command, memory_limit)
    _set_group(child)
    ended, number, peak = _watch(child, started + seconds, wake_read)
    os.write(1, f"{ended} {number} {time.monotonic() - started!r} {peak}\n".encode("ascii"))


def _start_command(command: list[str], memory_limit: int) -> None:
    """Turn this forked process into the command; does not return."""
    try:
        _set_group(0)
        for number in (signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        if memory_limit:
            # A system that refuses (macOS) runs without a bound.
            with contextlib.suppress(OSError, ValueError):
                hard = resource.getrlimit(resource.RLIMIT_AS)[1]
                bound = memory_limit if hard == resource.RLIM_INFINITY else min(memory_limit, hard)
                resource.setrlimit(resource.RLIMIT_AS, (bound, bound))
        os.execvp(command[0], command)
    except OSError as error:
        os.write(2, f"cannot start {command[0]}: {error.strerror}\n".encode())
    finally:
        os._exit(CANNOT_START)


def _set_group(child: int) -> None:
    """Give the child its own process group; called on both sides of the fork, the first one counts."""
    with contextlib.suppress(OSError):
        os.setpgid(child, child)


def _watch(child: int, deadline: float, wake: int) -> tuple[str, int, int]:
    """Wait for the end of the child, the deadline, SIGTERM or the end of standard input."""
    while True:
        remaining = deadline - time.monotonic()
        ready = select.select([0, wake], [], [], max(remaining, 0.0))[0]
        signals = os.read(wake, 512) if wake in ready else b""
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            return (*_explain(status), _bytes(usage))
        if not ready or 0 in ready or signal.SIGTERM in signals:
            os.killpg(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            return "time", 0, _bytes(usage)


def _explain(status: int) -> tuple[str, int]:
    if os.WIFSIGNALED(status):
        return "signal", os.WTERMSIG(status)
    return "exit", os.WEXITSTATUS(status)


def _bytes(usage: resource.struct_rusage) -> int:
    return usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    main(sys.argv[1:])
