"""Node distances against node positions: the figures of S&K, and what lies beyond them."""
