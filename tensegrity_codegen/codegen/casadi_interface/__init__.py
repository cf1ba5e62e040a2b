"""CasADi's interface for external functions: the functions of a library, and their derivatives."""
