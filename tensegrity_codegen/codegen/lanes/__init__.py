"""Emitter `lanes`: straight-line C whose forces are worked out for four members at a time in vectors."""
