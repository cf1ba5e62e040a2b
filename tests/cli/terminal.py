"""Commands in a terminal of their own (a pseudo-terminal), for tests of what they draw there."""

import os
import re
import select
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence

CONTROL = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")  # sequences that move the cursor, erase, or colour

LONGEST = 60.0  # s


class TerminalRun:
    """A command whose stderr is a terminal; stdout is one too, or a pipe.

    Parameters
    ----------
    words : sequence of str
        The command.
    columns : int
        Width of the terminal.
    is_piped : bool
        Whether stdout is a pipe.
    variables : mapping of str to str
        Of the environment, in addition.
    """

    def __init__(
        self, words: Sequence[str], columns: int, is_piped: bool, variables: Mapping[str, str]
    ) -> None:
        import pty
        import termios

        self.terminal, end = pty.openpty()
        termios.tcsetwinsize(end, (24, columns))
        known = {key: os.environ[key] for key in os.environ if key not in ("NO_COLOR", "FORCE_COLOR")}
        known |= {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path), "TERM": "xterm-256color"}
        known |= {"COLUMNS": str(columns)} | dict(variables)
        self.process = subprocess.Popen(
            list(words),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if is_piped else end,
            stderr=end,
            env=known,
        )
        os.close(end)
        self.shown = ""

    def read_until(self, is_shown: Callable[[str], bool]) -> str:
        """Return all that the terminal has shown, once that is true of it or the command has ended.

        Raises TimeoutError where nothing is shown for LONGEST seconds.
        """
        while not is_shown(self.shown):
            if not select.select([self.terminal], [], [], LONGEST)[0]:
                self.process.kill()
                raise TimeoutError(self.shown[-2000:])
            try:
                data = os.read(self.terminal, 65536)
            except OSError:  # the command has ended
                break
            if not data:
                break
            self.shown += data.decode("utf-8", errors="replace")
        return self.shown

    def go_on(self) -> None:
        """Let a command go on that waits for a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(b"\n")
        self.process.stdin.flush()

    def finish(self) -> tuple[int, str, str]:
        """Return exit code, all that the terminal has shown, and what went to the pipe."""
        shown = self.read_until(lambda text: False)
        piped = self.process.stdout.read().decode("utf-8") if self.process.stdout else ""
        code = self.process.wait()
        os.close(self.terminal)
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()
        return code, shown, piped
