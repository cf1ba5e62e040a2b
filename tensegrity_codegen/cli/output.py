"""What a verb says: one JSON object or readable text on stdout, progress and errors on stderr, exit codes."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import typer
from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from tensegrity_codegen.errors import TensegrityError

__all__ = ["Output", "plain"]


class Output:
    """Where a verb writes; as_json: one object on stdout instead of text."""

    def __init__(self, as_json: bool) -> None:
        self.as_json = as_json
        self.human = Console(highlight=False)
        self.aside = Console(stderr=True, highlight=False)

    def result(self, data: Mapping[str, Any], *readable: RenderableType) -> None:
        """Print the verb's result: `data` as JSON, or `readable`."""
        if self.as_json:
            print_json(data)
        else:
            for item in readable:
                self.human.print(item, soft_wrap=isinstance(item, str), markup=False)

    def warn(self, text: str) -> None:
        """Print a warning on stderr."""
        self.aside.print(f"warning: {text}", style="yellow", markup=False, soft_wrap=True)

    def fail(self, error: TensegrityError) -> typer.Exit:
        """Print the error, as text on stderr and with --json as an object on stdout; return the exit."""
        self.aside.print(f"error: {error}", style="red", markup=False, soft_wrap=True)
        if self.as_json:
            print_json({"status": "error", **error.as_dict()})
        return typer.Exit(error.exit_code)

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Turn errors made for users into a message and an exit code; leave defects alone."""
        try:
            yield
        except TensegrityError as error:
            raise self.fail(error) from error

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[[float], None]]:
        """Yield a function of the fraction done that moves a bar on stderr, if that is a terminal."""
        columns = (TextColumn(title), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        with Progress(
            *columns, console=self.aside, transient=True, disable=not self.aside.is_terminal
        ) as bar:
            task = bar.add_task(title, total=1.0)
            yield lambda fraction: bar.update(task, completed=fraction)


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout."""
    sys.stdout.write(json.dumps(plain(data), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """Return `value` in JSON's types; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
