"""What is written to standard output and standard error as it is."""

import os
import sys
from contextlib import suppress
from typing import Any


def print_text(text: str) -> None:
    """Write to stdout at once; a reader that has gone away is no error. Raises OSError, as on a full disk."""
    if sys.stdout is None:  # closed by the caller
        return
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        drop_output(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise


def print_aside(line: str) -> None:
    """Write one line to stderr at once; where nobody can read it, it is dropped."""
    if sys.stderr is None:  # closed by the caller
        return
    try:
        sys.stderr.write(line + "\n")
        sys.stderr.flush()
    except OSError:
        drop_output(sys.stderr)


def drop_output(stream: Any) -> None:
    """Let a stream whose reader has gone away lead nowhere, so that closing it at the end does not fail."""
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
