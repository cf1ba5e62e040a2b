"""Files of other tools read as scenes: CSV tables and NTRT structures."""
