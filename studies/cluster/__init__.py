"""Many motions on a Dask cluster."""
