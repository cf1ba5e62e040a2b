"""From C text to a loadable library: toolchain, flags, compilation and cache."""
