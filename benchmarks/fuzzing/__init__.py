"""Structure-aware fuzzing of everything that is read from outside; `benchmarks/fuzz.py` runs it.

A case is made from the name of its kind and a seed alone: the same files on any machine. Its outcome is "refused" (one
line) or "accepted"; anything else is a failure.
"""
