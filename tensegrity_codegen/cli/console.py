"""The console that verbs print on, in a module of its own: Rich is imported where something is printed."""

from rich.console import Console

from tensegrity_codegen.cli.streams import drop_output


class PatientConsole(Console):
    """A console whose reader may go away, as in `... | head`: what follows is dropped, the work goes on."""

    def on_broken_pipe(self) -> None:
        """Drop all further output."""
        self.quiet = True
        drop_output(self.file)
