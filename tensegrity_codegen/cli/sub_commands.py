"""A verb that has sub-commands beside its own work: `sweep SCENE ...`, and `sweep summary FILE.zarr`."""

from collections.abc import Callable
from typing import Any, ClassVar

from tensegrity_codegen.cli.option_names import VerbCommand
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.cli.verb_group import build_command


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
        rows = [(name, (run.__doc__ or "").partition("\n")[0]) for name, run in self.sub_commands.items()]
        with formatter.section("Sub-commands"):
            formatter.write_dl([(f"{ctx.command_path} {name}", text) for name, text in rows])
