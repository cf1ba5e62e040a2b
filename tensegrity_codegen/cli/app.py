"""All verbs in one application, and how it ends: 0 good, 2 bad input, 3 no convergence or unstable."""

import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import typer

from tensegrity_codegen.cli.commands import VerbGroup
from tensegrity_codegen.cli.output import Output, explain_system_error
from tensegrity_codegen.cli.streams import print_aside, print_text
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.temporary_files import announce_end
from tensegrity_codegen.system.version import VERSION

INTERRUPTED = 130
# click's base class of such errors, from wherever typer takes click: a package or a copy of its own.
ClickError: Any = typer.BadParameter.__mro__[2]


class CommandLineError(TensegrityError):
    """Verbs, arguments or options that the command line does not have or cannot read."""


app = typer.Typer(
    name="tensegrity-codegen",
    cls=VerbGroup,
    help="From a scene file to a compiled C library that computes a tensegrity structure.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def version_option(
    version: bool = typer.Option(False, "--version", is_eager=True, help="Print the version and exit."),
) -> None:
    """From a scene file to a compiled C library that computes a tensegrity structure."""
    if version:
        typer.echo(f"tensegrity-codegen {VERSION}")
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line (sys.argv if no arguments are given) and exit; Ctrl-C ends with exit code 130.

    With --json, wrong usage too gives one object on stdout.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    output = Output("--json" in words)
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")  # file names may hold bytes that are no text
    try:
        code = app(words, prog_name="tensegrity-codegen", standalone_mode=False)
    except ClickError as error:
        code = _refuse_usage(error, output)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except OSError as error:
        code = output.fail(explain_system_error(error)).exit_code
    if code == INTERRUPTED:
        print_aside("interrupted")
        announce_end()
    sys.exit(_flush(code, output))


def _flush(code: int | None, output: Output) -> int | None:
    """Write what is left for stdout; return the exit code, 2 where it cannot be written.

    What stays in the buffer of a full disk would let Python itself end with exit code 120.
    """
    try:
        print_text("")
    except OSError as error:
        return code or output.fail(explain_system_error(error)).exit_code
    return code


def _refuse_usage(error: Any, output: Output) -> int:
    """Say what is wrong with the command line; return the exit code."""
    if not output.as_json:
        error.show()
        return 2
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "tensegrity-codegen"
    return output.fail(
        CommandLineError(error.format_message(), where="command line", hint=f"{command} --help")
    ).exit_code
