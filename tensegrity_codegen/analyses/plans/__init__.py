"""Plans of the analyses `plan` and `control`: models that move to targets, and the motion that is held."""
