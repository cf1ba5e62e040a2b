"""Tests of tensegrity_codegen.runtime.profiles."""
