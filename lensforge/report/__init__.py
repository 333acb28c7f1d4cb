"""The report: one self-contained HTML page and its figures, from the results of a lens and nothing else."""
