"""Python packages of compiled libraries, which need NumPy alone: text, metadata and archive."""
