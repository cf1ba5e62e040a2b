"""Sections of members: the least mass that carries the loads, with a proof."""
