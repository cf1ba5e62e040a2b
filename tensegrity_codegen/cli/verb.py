"""The record of a verb for the command line, and groups of options that it takes as one argument."""

import functools
import inspect
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand

from tensegrity_codegen.system.errors import TensegrityError


@dataclass(frozen=True)
class OptionGroup:
    """Options that a function lists when they are first needed, as fields; the verb takes a dictionary."""

    list_fields: Callable[[], "Mapping[str, tuple[Any, Any]]"]  # name -> (annotation, default or ...)


def expand_groups(run: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function with the options of all groups as its own arguments, from which Typer makes them."""
    hints = get_type_hints(run, include_extras=True)
    groups: dict[str, tuple[Any, tuple[str, ...]]] = {}
    parameters: dict[str, inspect.Parameter] = {}
    for name, parameter in inspect.signature(run).parameters.items():
        listed = _list_fields(hints[name])
        if listed is None:
            parameters[name] = parameter.replace(annotation=hints[name])
            continue
        groups[name] = (hints[name] if is_dataclass(hints[name]) else dict, tuple(listed))
        for field, (annotation, default) in listed.items():
            kind = inspect.Parameter.KEYWORD_ONLY
            start = inspect.Parameter.empty if default is ... else default
            parameters[field] = inspect.Parameter(field, kind, annotation=annotation, default=start)
    if not groups:
        return run

    @wraps(run)
    def expanded(**given: Any) -> Any:
        for name, (build, names) in groups.items():
            given[name] = build(**{field: given.pop(field) for field in names})
        return run(**given)

    keyword = [argument.replace(kind=inspect.Parameter.KEYWORD_ONLY) for argument in parameters.values()]
    expanded.__signature__ = inspect.Signature(keyword)  # type: ignore[attr-defined]
    expanded.__annotations__ = {name: argument.annotation for name, argument in parameters.items()}
    return expanded


def _list_fields(annotation: Any) -> Mapping[str, tuple[Any, Any]] | None:
    """Return the options of a group, None for an annotation that is none."""
    if is_dataclass(annotation):
        hints = get_type_hints(annotation, include_extras=True)
        return {field.name: (hints[field.name], _find_default(field)) for field in fields(annotation)}
    if get_origin(annotation) is Annotated:
        group = next((field for field in get_args(annotation) if isinstance(field, OptionGroup)), None)
        return None if group is None else group.list_fields()
    return None


def _find_default(item: "Field[Any]") -> Any:
    return ... if item.default is MISSING else item.default


# Names of the library's Python arguments, as the options that the running verb has for them.
#
# Below the command line, messages name arguments as Python has them: `rtol`, `overwrite=True`. Here these
# become --rtol, --overwrite.


_ARGUMENT = re.compile(r"`([a-z_]+)(?:=([^`]*))?`")
_options: dict[str, str] = {}  # of the running verb: argument -> option
_words: list[str] = []  # of the running verb: the whole command
# Options that many verbs share: `--help` lists them after those of the verb itself.
COMMON = {
    *(
        "--input",
        "--compiler",
        "--flags",
        "--precision",
        "--batch-width",
        "--overwrite",
        "--fresh",
        "--peers",
    ),
    *("--all", "--strict", "--json", "--help"),
}


class VerbCommand(TyperCommand):
    """A command that makes its options and its own words known while it runs."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """List arguments, the options of the verb itself, and the common ones."""
        records: dict[str, list[Any]] = {"Arguments": [], "Options": [], "Common options": []}
        for parameter in self.get_params(ctx):
            is_common = not COMMON.isdisjoint(parameter.opts)
            kind = "Common options" if is_common else "Options"
            kind = "Arguments" if parameter.param_type_name == "argument" else kind
            record = parameter.get_help_record(ctx)
            records[kind] += [] if record is None else [record]
        width = max((len(row[0]) for row in records["Options"] + records["Common options"]), default=0)
        for title, rows in records.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(row[0].ljust(min(width, 28)), row[1]) for row in rows])

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words after the verb."""
        _words[:] = [*str(ctx.command_path).split(), *args]
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the verb."""
        _options.clear()
        for parameter in self.params:
            long_names = [flag for flag in parameter.opts if flag.startswith("--")]
            if parameter.name and long_names:
                _options[parameter.name] = long_names[0]
        return super().invoke(ctx)


def quote_command() -> str:
    """Return the command that runs, quoted for a shell."""
    return shlex.join(_words)


def name_options(value: Any) -> Any:
    """Return a text, or the texts of nested dicts and lists, with options in place of arguments."""
    if isinstance(value, str):
        return _ARGUMENT.sub(_name_option, value) if "`" in value else value
    if isinstance(value, Mapping):
        return {key: name_options(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(name_options(entry) for entry in value) if type(value) in (list, tuple) else value
    return value


def name_options_in_error(error: TensegrityError) -> None:
    """Replace arguments by options in an error's texts; its place may be one, or one and its 'value'."""
    name, quote, value = error.where.partition(" '")
    error.where = _options.get(name, name) + quote + value
    error.problem = name_options(error.problem)
    error.allowed = name_options(error.allowed)
    error.hint = name_options(error.hint)


def _name_option(found: re.Match[str]) -> str:
    name, value = found[1], found[2]
    if name not in _options:
        return found[0]
    argument = "" if value in (None, "True") else f" {value.strip(chr(34))}"
    return _options[name] + argument


# Groups of verbs in `--help`, and the least `order` of each.
GROUPS = {
    "Scenes": 0,
    "Structures at rest": 100,
    "Motions and pictures": 200,
    "Plans and control": 300,
    "Many cases": 400,
    "Libraries in C, other programs": 500,
    "Installation": 600,
    "Comparisons and papers": 700,
}


@dataclass(frozen=True)
class Verb:
    """One verb of the command line; a module of `cli/verbs/` defines one as its `VERB`.

    run: does the work. Typer makes the arguments and options from its signature, the help from its docstring;
        a parameter whose type is a dataclass stands for one option for each of its fields.
    order: place in the list of `--help`; decides the group, see GROUPS.
    name: the word on the command line; empty: the name of `run` with `-` for `_`.
    command: class of the command, for a verb whose help is computed.
    """

    run: Callable[..., Any]
    order: int
    name: str = ""
    command: type[VerbCommand] = VerbCommand

    @property
    def word(self) -> str:
        """The word on the command line."""
        return self.name or self.run.__name__.replace("_", "-")

    @property
    def group(self) -> str:
        """The heading in `--help` under which the verb stands."""
        return [name for name, order in GROUPS.items() if order <= self.order][-1]


@functools.cache
def build_command(verb: Verb) -> Any:
    """Return the command of a verb, with its options."""
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    alone.command(verb.word, cls=verb.command)(expand_groups(verb.run))
    return typer.main.get_command(alone)


class VerbWithSubCommands(VerbCommand):
    """A verb whose first word may be the name of a sub-command; the help of the verb lists them.

    A file that has such a name is meant where its path is written: `./summary`.
    """

    sub_commands: ClassVar[dict[str, Callable[..., Any]]] = {}

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Read the words after the verb, as those of a sub-command where its name is the first."""
        if args and args[0] in self.sub_commands:
            command = build_command(Verb(self.sub_commands[args[0]], 0, args[0]))
            return command.make_context(f"{info_name} {args[0]}", args[1:], parent, **extra)
        return super().make_context(info_name, args, parent, **extra)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """List the sub-commands."""
        rows = [
            (name, " ".join((run.__doc__ or "").partition("\n\n")[0].split()))
            for name, run in self.sub_commands.items()
        ]
        with formatter.section("Sub-commands"):
            formatter.write_dl([(f"{ctx.command_path} {name}", summary) for name, summary in rows])
