"""Single bugs, drawn at random, and the tests that should notice them: the parts of mutants.py."""
