"""Pages of plans and of feedback."""
