"""Errors, files, processes, progress, version: the needs of every program."""
