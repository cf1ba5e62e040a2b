"""What a scene file may say: the pydantic models of its keys."""
