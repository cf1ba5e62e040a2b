"""One file a formulation; each builds a SymbolicModel from a structure and never imports another."""
