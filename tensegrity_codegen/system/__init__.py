"""Errors, files, processes, progress, version: what every program needs."""

__all__: list[str] = []
