"""Contacts with the ground in statics: their forces, and whether feet can hold a rigid structure."""
