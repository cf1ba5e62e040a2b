"""Studies: what the papers show, computed by the general machinery; each returns plain numbers and arrays."""
