"""The version of this package; the latest release in CHANGELOG.md has the same number."""

VERSION = "0.4.0"
