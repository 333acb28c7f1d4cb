"""``python -m lensforge`` is the command line."""

from lensforge.cli import main

main()
