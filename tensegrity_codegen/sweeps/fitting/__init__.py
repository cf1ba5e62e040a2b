"""Numbers of a scene from what was measured, or from what a motion shall do, by derivatives of motions."""
