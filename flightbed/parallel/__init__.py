"""One executor for studies and campaigns: local processes or a dask cluster. The only package that imports dask.

It runs any task and does not depend on flights.
"""
