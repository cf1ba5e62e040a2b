"""Choice of the integration method and control of the error at the samples."""
