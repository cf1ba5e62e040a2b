"""Time integration: methods, run options, events and the calls into C."""
