"""Code blocks of the documentation: found, completed by what a page presupposes, run."""
