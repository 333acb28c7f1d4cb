"""Makers of small result folders are those of the report's tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "report"))
