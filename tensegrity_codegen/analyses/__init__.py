"""Analyses, a record each: options, needs of a library, results, for one case and for many."""
