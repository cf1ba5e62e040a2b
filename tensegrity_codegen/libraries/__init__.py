"""Build the library for a request, or find it in the cache."""

from tensegrity_codegen.libraries.build_library import build_library, check_buildable
from tensegrity_codegen.libraries.built_library import BuiltLibrary
from tensegrity_codegen.libraries.compile_source import compile_source

__all__ = ["BuiltLibrary", "build_library", "check_buildable", "compile_source"]
