"""Scenes as environments of gymnasium: many copies side by side, what they see, and what is randomised."""
