"""The pydantic models of the keys of a scene file."""
