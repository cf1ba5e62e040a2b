"""Forces of the ground in statics, whether feet can hold a rigid structure, and memory of members at rest."""
