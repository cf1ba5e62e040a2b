"""From the values of a case to the arguments of a library, and which cases share one library."""
