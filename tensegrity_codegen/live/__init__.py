"""Pages in which a structure or a motion is turned, played and asked: one file, nothing from outside."""
