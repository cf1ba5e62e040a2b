"""Controllers in C: feedback, estimator and the model that it needs, as files that work alone."""
