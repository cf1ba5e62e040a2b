"""Timed motions of actuated structures, and feedback that holds them under disturbances."""
