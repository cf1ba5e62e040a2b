"""Other ways to compute the same, one file each; a package that is not installed is told as such."""
