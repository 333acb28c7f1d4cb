"""Radiance archives for the tests."""

from pathlib import Path

import numpy as np

from lensforge.sources.radiance_emitter import RadianceTable


def write_radiance(path: Path, table: RadianceTable) -> None:
    """Write ``table`` so that ``read_radiance`` finds the same numbers."""
    names = ("x_mm", "y_mm", "c_deg", "gamma_deg", "radiance")
    np.savez_compressed(path, **{name: getattr(table, name) for name in names})
