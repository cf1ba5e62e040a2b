"""The scene file, its schema, checks and shapes, and the structure made from it."""
