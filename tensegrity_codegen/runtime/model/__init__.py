"""A compiled library in Python: its functions, array shapes, statuses and batches."""
