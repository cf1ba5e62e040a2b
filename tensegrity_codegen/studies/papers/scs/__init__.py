"""The two-stage tower of SCS: symmetrical configurations, reconfiguration, the full model that follows it."""
