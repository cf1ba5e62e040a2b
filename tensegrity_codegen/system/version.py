"""The version of this package; the latest release in CHANGELOG.md has the same number."""

__all__ = ["VERSION"]

VERSION = "0.2.0"
