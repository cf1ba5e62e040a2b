"""Simulation of one or many motions, with conditions that end them."""
