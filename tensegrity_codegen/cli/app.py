"""All verbs in one application, and how it ends: 0 good, 2 bad input, 3 no convergence or unstable."""

import inspect
import itertools
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from tensegrity_codegen.cli import analysis_verb
from tensegrity_codegen.cli.output import Output, explain_system_error
from tensegrity_codegen.cli.streams import print_aside, print_text
from tensegrity_codegen.cli.verb import Verb, build_command
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.temporary_files import announce_end
from tensegrity_codegen.system.version import VERSION

PACKAGE = "tensegrity_codegen.cli.verbs"


def find_verbs() -> list[Verb]:
    """Return the verbs of all modules of `cli/verbs/` and `analyses/`, in their order."""
    verbs = [verb for module in _list_modules() if (verb := _read_verb(module)) is not None]
    return sorted(verbs, key=lambda verb: verb.order)


def find_verb(word: str) -> Verb | None:
    """Return the verb of a word, of which only its own module is imported, or None."""
    module = word.replace("-", "_")
    if module in _list_modules() and (verb := _read_verb(module)) is not None and verb.word == word:
        return verb
    return next((verb for verb in find_verbs() if verb.word == word), None)


def _list_modules() -> list[str]:
    """Return the names of modules with verbs of their own, and of those of analyses."""
    names = [module.name for module in iter_modules(import_module(PACKAGE).__path__)]
    return [*names, *(name for name in analysis_verb.list_modules() if name not in names)]


def _read_verb(module: str) -> Verb | None:
    """Return the verb of a module, None for an analysis without one."""
    if module in analysis_verb.list_modules() and not find_spec(f"{PACKAGE}.{module}"):
        return analysis_verb.read_verb(module)
    verb = import_module(f"{PACKAGE}.{module}").VERB
    assert isinstance(verb, Verb)
    return verb


class Commands(Mapping[str, Any]):
    """The commands of all verbs by name; one is built when it is asked for."""

    def __getitem__(self, word: str) -> Any:
        verb = find_verb(word)
        if verb is None:
            raise KeyError(word)
        return build_command(verb)

    def __iter__(self) -> Iterator[str]:
        return (verb.word for verb in find_verbs())

    def __len__(self) -> int:
        return len(find_verbs())


class VerbGroup(TyperGroup):
    """The command `tensegrity-codegen`, whose commands are the verbs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = Commands()

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the words of all verbs."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the verbs with the first sentence of their help; options would take most of the time."""
        verbs = find_verbs()
        widest = max(len(verb.word) for verb in verbs)
        for group, members in itertools.groupby(verbs, key=lambda verb: verb.group):
            with formatter.section(group):
                formatter.write_dl([(verb.word.ljust(widest), _first_sentence(verb)) for verb in members])


def _first_sentence(verb: Verb) -> str:
    """Return the first sentence of a verb's help without its full stop, whatever its length."""
    return " ".join((inspect.getdoc(verb.run) or "").split()).partition(". ")[0].removesuffix(".")


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
    """Run the command line (by default sys.argv) and exit; 130 after Ctrl-C. --json: always one object."""
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
    """Write the rest of stdout; return the exit code, 2 if that fails, for which Python itself has 120."""
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
