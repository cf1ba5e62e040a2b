"""Where the tasks of a sweep run: processes on this machine, or a Dask cluster."""
