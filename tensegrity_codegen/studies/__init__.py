"""The three papers, error against run time, and stability in extreme cases."""
