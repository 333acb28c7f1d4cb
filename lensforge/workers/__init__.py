"""Other processes that compute: workers of Dask, here or on other machines, and a second process beside this one."""
