"""Many copies of a motion, advanced sample by sample."""
