"""The command line: `tensegrity-codegen VERB SCENE [options]`."""

from __future__ import annotations

from tensegrity_codegen.cli.app import main

__all__ = ["main"]
