"""Which tensions a structure can have at a configuration, and which motions they leave free."""
