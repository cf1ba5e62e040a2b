"""The command line: `tensegrity-codegen VERB SCENE [options]`."""
