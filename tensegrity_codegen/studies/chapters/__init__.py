"""The papers as chapters of a page: what a paper states, what comes out here, and why the two differ."""
