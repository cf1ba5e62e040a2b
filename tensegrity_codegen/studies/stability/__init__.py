"""Stiff and extreme cases made from a scene: who survives, who stops with a status, who is wrong."""
