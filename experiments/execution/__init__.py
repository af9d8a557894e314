"""Suites carried out: here, or on a Dask cluster."""
