"""One member: its law, its forces and blocks, as expressions and kernels."""
