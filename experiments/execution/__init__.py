"""Suites carried out: here, on a Dask cluster, on Slurm, and in parts that are merged."""
