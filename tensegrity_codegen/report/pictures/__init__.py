"""Pictures and films of structures and motions."""
