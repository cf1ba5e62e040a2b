"""Emitter `table`: kernels of one member in loops over constant tables; its code does not grow."""
