"""From expressions to C text, a compiled library and its cache."""
