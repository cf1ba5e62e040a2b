"""Errors, files, processes, progress, version: what every program needs."""
