"""The version of this package, said once."""

__all__ = ["VERSION"]

VERSION = "0.1.0"
