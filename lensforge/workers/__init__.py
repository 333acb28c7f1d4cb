"""Workers of Dask, on this machine or on others: a function of many items, of which each may run anywhere."""
