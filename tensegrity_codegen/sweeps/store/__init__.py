"""Results of a sweep on disk: a Zarr folder that is written chunk by chunk, resumed and read again."""
