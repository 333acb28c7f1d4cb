"""The report: one self-contained HTML page and its figures, from the files of a result folder and nothing else."""
