"""The structure as frozen arrays: nodes, members, bodies, mass plan and order of summation."""
