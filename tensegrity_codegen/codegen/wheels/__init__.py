"""Python packages of compiled libraries, which need NumPy alone: text, metadata and archive."""

__all__: list[str] = []
