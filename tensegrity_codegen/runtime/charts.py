"""Angles of bodies and their poles, where the angles lose their meaning."""

from __future__ import annotations

from tensegrity_codegen.manifest import Manifest

__all__ = ["NEAREST_POLE", "NEAR_POLE", "name_charts"]

# Sine of the angle to the pole of its chart below which a body's angles are not to be trusted.
NEAR_POLE = 1e-3

# The same, below which a configuration is not looked at.
NEAREST_POLE = 1e-6


def name_charts(manifest: Manifest) -> list[str]:
    """Return the names of the bodies that have angles, in the order of `chart_margin`."""
    names = (name.rpartition("_") for name in manifest.coordinate_name)
    return list(dict.fromkeys(body for body, _, _ in names))
