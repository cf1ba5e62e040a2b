"""Output of a verb: JSON or readable text on stdout, progress and errors on stderr, exit codes, files."""

import json
import os
import re
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tensegrity_codegen.cli.streams import (
    ProgressBar,
    can_draw,
    drop_output,
    name_duration,
    print_aside,
    print_text,
)
from tensegrity_codegen.cli.verb import name_options, name_options_in_error
from tensegrity_codegen.report.long_table import AROUND, LongTable, find_most_rows, is_cut
from tensegrity_codegen.system.errors import (
    FormulationError,
    OutputError,
    TensegrityError,
    escape_controls,
    name_list,
)
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.files import check_ending, check_output, plain
from tensegrity_codegen.system.progress import watched_passes, work_pass
from tensegrity_codegen.system.temporary_files import announce_advice

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from tensegrity_codegen.structure.bodies import BodySystem
    from tensegrity_codegen.structure.structure import Structure
    from tensegrity_codegen.system.journal import Resumption
    from tensegrity_codegen.tables.request import ModelRequest

MOST_LINES = 60  # of a result in which tables are cut
MOST_DRAWN = 100  # rows, up to which Rich draws a table
MOST_WARNINGS = 20
MOST_NAMES = 10  # of a longer list in a sentence
_LONG_LIST = re.compile(r"[^\s,;:]+(?:, [^\s,;:]+){20,}")


class Output:
    """Where a verb writes; as_json: one object on stdout instead of text; whole: all rows of long tables.

    Every verb says how long it took: in the last line on stderr, with JSON in `seconds` instead.
    """

    def __init__(self, as_json: bool, whole: bool = False) -> None:
        self.as_json, self.whole = as_json, whole
        self.started = time.monotonic()
        self._bar: ProgressBar | None = None
        self.warned: list[str] = []
        self.resumed: list[dict[str, Any]] = []

    @cached_property
    def human(self) -> "Console":
        """Standard output, for text."""
        return _open_console(stderr=False)

    @cached_property
    def aside(self) -> "Console":
        """Standard error."""
        return _open_console(stderr=True)

    def result(
        self,
        data: Mapping[str, Any],
        *readable: "RenderableType | LongTable | Callable[[], RenderableType]",
    ) -> None:
        """Print the verb's result: `data` as JSON with the time that the verb took, or `readable`."""
        self._end_bar()
        seconds = time.monotonic() - self.started
        if self.as_json:
            data = name_options(data)
            warnings = list(dict.fromkeys([*self.warned, *data.get("warnings", ())]))
            warned = {"warnings": warnings} if warnings or "warnings" in data else {}
            timing = {"took_seconds": seconds} if "seconds" in data else {"seconds": seconds}
            print_json({**data, **warned, **timing})
        else:
            blocks = [block() if callable(block) else block for block in readable]
            counts = [block.count for block in blocks if isinstance(block, LongTable)]
            limit = find_most_rows(counts, MOST_LINES - sum(map(_count_lines, blocks)))
            for block in blocks:
                if isinstance(block, LongTable):
                    self._print_long(block, limit)
                    continue
                shown = name_options(self._cut_names(block) if isinstance(block, str) else block)
                self.human.print(shown, soft_wrap=isinstance(block, str), markup=False, emoji=False)
            print_text("")

    def _print_long(self, table: LongTable, most: int) -> None:
        """Print a table: whole, or its `most` most important rows and how to see the others."""
        if not self.whole and is_cut(table.count, most):
            short = table.short or table
            is_short = table.short is not None and not is_cut(short.count, most)
            message = (
                f"{short.title}; all {table.count:,} {table.things}" if is_short else short.describe_cut(most)
            )
            rows = range(short.count) if is_short else short.pick(most)
            print_text(short.write(rows, f"{message} with --all, and in --json"))
        elif table.count > MOST_DRAWN or not table.fits(self.human.width):
            print_text(table.write(range(table.count), table.title))
        else:
            self.human.print(table, markup=False, emoji=False)

    def _cut_names(self, text: str) -> str:
        """Return a sentence in which long lists of names are cut, unless all is asked for."""
        return text if self.whole else _LONG_LIST.sub(_cut_list, text)

    def warn(self, *texts: str) -> None:
        """Print warnings on stderr, each once; with --json they are among the result's "warnings" too."""
        for message in map(name_options, texts):
            if message in self.warned:
                continue
            self.warned.append(message)
            if self.whole or len(self.warned) <= MOST_WARNINGS:
                self._say(f"warning: {self._cut_names(message)}", "yellow")

    def note(self, text: str) -> None:
        """Print a sentence on stderr that is neither a result nor a warning."""
        self._say(name_options(text))

    def _say(self, text: str, style: str | None = None) -> None:
        """Print on stderr, by Rich only where that has colours."""
        if can_draw() or "FORCE_COLOR" in os.environ:
            self.aside.print(text, style=style, markup=False, soft_wrap=True)
        else:
            print_aside(text)

    def load(
        self, scene: Path, *, settles: bool = False, sags: bool = False
    ) -> "tuple[Structure | BodySystem, ModelRequest]":
        """Read a scene and print probable slips in it; settles, sags: see `find_scene_warnings`."""
        from tensegrity_codegen.pipeline.compile_scene import load_scene

        subject, request = load_scene(scene)
        self.warn_of(subject, settles=settles, sags=sags)
        return subject, request

    def warn_of(
        self, subject: "Structure | BodySystem", *, settles: bool = False, sags: bool = False
    ) -> None:
        """Print what looks like a slip in a scene."""
        from tensegrity_codegen.scene.checks.scene_warnings import find_scene_warnings

        self.warn(*find_scene_warnings(subject, settles=settles, sags=sags))

    def fail(self, error: TensegrityError) -> typer.Exit:
        """Print the error, as text on stderr and with --json as an object on stdout; return the exit."""
        self._end_bar()
        name_options_in_error(error)
        self._say(f"error: {error}", "red")
        if time.monotonic() - self.started >= ProgressBar.INTERVAL:
            self._say_time()
        if self.as_json:
            print_json({"status": "error", **error.as_dict()})
        return typer.Exit(error.exit_code)

    @contextmanager
    def guard(self, scene: Path | None = None) -> Iterator[None]:
        """Turn errors made for users and of the machine in `scene` into a message and an exit code."""
        self._bar = bar = ProgressBar(lambda: self.aside)
        bar.start()
        try:
            with watched_passes(bar), self._shown_warnings():
                yield
            self._finish()
        except typer.Exit:  # after a result
            self._finish()
            raise
        except TensegrityError as error:
            if scene is not None and isinstance(error, FormulationError):
                # The place of an error starts with the file of the scene, as in errors of reading.
                key = error.where.rpartition(": ")[2]
                if key.startswith(("nodes.", "members.", "model.", "parameters")):
                    error.where = f"{scene}: {key}"
            raise self.fail(error) from error
        except OSError as error:
            raise self.fail(explain_system_error(error)) from error
        except MemoryError as error:
            problem = "there is not enough memory for this"
            raise self.fail(TensegrityError(problem, hint="request fewer samples or quantities")) from error
        finally:
            self._end_bar()

    def _finish(self) -> None:
        """End the bar, and say on stderr how many warnings are not printed, and how long the verb took."""
        self._end_bar()
        if not self.whole and len(self.warned) > MOST_WARNINGS:
            print_aside(f"{len(self.warned) - MOST_WARNINGS} more warnings; --json has all")
        if not self.as_json:
            self._say_time()

    def _say_time(self) -> None:
        print_aside(f"took {name_duration(time.monotonic() - self.started)}")

    @contextmanager
    def _shown_warnings(self) -> Iterator[None]:
        """Print this package's Python warnings as those of verbs, each once."""
        from tensegrity_codegen.system.cache_root import CacheFolderWarning

        shown: set[str] = set()
        with warnings.catch_warnings():
            usual = warnings.showwarning

            def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
                if not issubclass(category, CacheFolderWarning):
                    usual(message, category, *place, **more)
                elif str(message) not in shown:
                    shown.add(str(message))
                    self.warn(str(message))

            warnings.simplefilter("always", CacheFolderWarning)
            warnings.showwarning = show
            yield

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[[float], None]]:
        """Yield a function of the fraction done of a pass."""
        with work_pass(title) as move:
            yield move

    @contextmanager
    def resumable(self, folder: Path) -> "Iterator[Callable[[Resumption], None]]":
        """Yield a function that reports results of an earlier run in `folder`; Ctrl-C says how to go on."""
        advice = f"{folder} keeps what is finished; the same command goes on from there"
        announce_advice(advice)
        try:
            yield self._resume
        except KeyboardInterrupt:
            self._end_bar()
            print_aside(advice)
            announce_advice("")
            raise
        announce_advice("")

    def _resume(self, taken: "Resumption") -> None:
        self.resumed.append(taken.as_dict())
        self.note(taken.describe(time.time()))

    def entitle(self, title: str) -> None:
        """Change what the command's bar says of the work."""
        if self._bar is not None:
            self._bar.title = title

    def _end_bar(self) -> None:
        if self._bar is not None:
            self._bar.stop()


def _open_console(*, stderr: bool) -> "Console":
    from rich.console import Console  # Rich is imported where something is printed

    class PipeConsole(Console):
        """A console whose reader may go away, as in `... | head`: what follows is dropped."""

        def render_str(self, text: str, **options: Any) -> Any:
            """Return a text as Rich shows it, without characters that steer the terminal."""
            return super().render_str(escape_controls(text), **options)

        def on_broken_pipe(self) -> None:
            """Drop all further output."""
            self.quiet = True
            drop_output(self.file)

    return PipeConsole(stderr=stderr, highlight=False)


def _count_lines(item: Any) -> int:
    """Return how many lines a part of a result takes, none for a long table."""
    if isinstance(item, str):
        return item.count("\n") + 1
    return 0 if isinstance(item, LongTable) else int(item.row_count) + AROUND


def _cut_list(found: re.Match[str]) -> str:
    """Return the first of many names, and the number of the others."""
    return name_list(found[0].split(", "), MOST_NAMES)


def list_files(files: Mapping[str, str]) -> str:
    """Return what is said of files that were written, a line each."""
    return "\n".join(f"wrote {path}" for path in files.values())


def print_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout."""
    print_text(json.dumps(plain(data), indent=2, allow_nan=False) + "\n")


def explain_system_error(error: OSError) -> OutputError:
    """Return the error for users of what the operating system refused."""
    hint = "check paths, permissions and free space"
    return OutputError(f"system error: {error.strerror or error}", where=str(error.filename or ""), hint=hint)


def check_result(
    path: Path | None, *endings: str, inputs: Iterable[Path] = (), overwrite: bool, draws: bool = False
) -> None:
    """Raise OutputError or MissingExtraError, before the work begins, where a result has no place."""
    if path is not None:
        check_ending(path, *endings)
        check_output(path, inputs=inputs, overwrite=overwrite)
        if draws:
            require_plot()
