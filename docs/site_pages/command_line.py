"""The command line as one page, made from the verbs themselves."""

import inspect
from typing import Any

import typer

from site_pages.markdown import escape, write_item
from tensegrity_codegen.cli.app import app
from tensegrity_codegen.cli.verb import Verb, VerbWithSubCommands, build_command


def write_command_line() -> str:
    """Return Markdown: a section for each verb and each of its sub-commands, with usage and options."""
    group: Any = typer.main.get_command(app)
    context = group.make_context("tensegrity-codegen", [], resilient_parsing=True)
    sections = []
    for word in group.list_commands(context):
        command = group.get_command(context, word)
        sections.append(_write_verb(command, word, context))
        if isinstance(command, VerbWithSubCommands):
            sections += [
                _write_verb(build_command(Verb(run, 0, name)), f"{word} {name}", context)
                for name, run in command.sub_commands.items()
            ]
    return "\n\n".join(sections)


def _write_verb(command: Any, words: str, parent: Any) -> str:
    context = command.make_context(words, [], parent=parent, resilient_parsing=True)
    parts = [f"## {words}"]
    usage = " ".join(command.collect_usage_pieces(context))
    parts.append(f"    tensegrity-codegen {words} {usage}")
    parts.append(_write_help(inspect.cleandoc(command.help or "")))
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    parts += [
        write_item(f"`{' '.join(name.split())}`", escape(" ".join(text.split())))
        for name, text in filter(None, records)
    ]
    return "\n\n".join(parts)


def _write_help(text: str) -> str:
    """Return the help as Markdown; lines that begin with a space, and examples, are code."""
    paragraphs = []
    for paragraph in text.replace("\b\n", "").split("\n\n"):
        lines = paragraph.splitlines()
        if all(line.startswith(" ") for line in lines):
            paragraphs.append("\n".join(f"    {line.strip()}" for line in lines))
        elif paragraph.startswith("Example: "):
            example = " ".join(paragraph.removeprefix("Example: ").split())
            paragraphs.append(f"Example:\n\n    {example}")
        else:
            paragraphs.append(escape(" ".join(lines)))
    return "\n\n".join(paragraphs)
