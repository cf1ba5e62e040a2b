"""Tensions that a structure can have at a configuration, and motions that they leave free."""
