"""The summary of a sweep: how cases ended, how results vary and why, as data and as one page."""
