"""How results are shown: pages, plots, and the notebook."""
