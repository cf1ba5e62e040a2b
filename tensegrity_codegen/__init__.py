"""From a scene file to a compiled C library that computes a tensegrity structure."""
