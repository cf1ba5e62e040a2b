"""What is emitted: from expressions to C text, a compiled library and its cache."""
