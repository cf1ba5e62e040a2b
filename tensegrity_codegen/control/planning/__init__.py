"""Plans: changes of rest lengths that move a structure through stable equilibria to a target.

`plan` (plan.py) is the entry; each file has one part of it.
"""
