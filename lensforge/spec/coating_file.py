"""Tables of a coating (.csv, .txt): angle (degrees), wavelength (nm) and reflectance, a row for each pair.

Columns are separated by commas, semicolons, tabs or blanks, in this order or as a first line names them; comments start
with ``#``.
"""

import re
from pathlib import Path

import numpy as np

from lensforge.errors import InputError
from lensforge.files import MIB, read_file

_MOST_BYTES = 32 * MIB
_COLUMNS = ("angle_deg", "wavelength_nm", "reflectance")

Rows = list[list[float]]


def read_coating(path: Path) -> tuple[list[float], list[float], Rows]:
    """Angles (degrees), wavelengths (nm), and reflectance [wavelength, angle] of the table at ``path``.

    Raises :class:`InputError`, one line, for a file that is none.
    """
    content = read_file(path, missing="give a table of the reflectance", most_bytes=_MOST_BYTES)
    lines = (line.split("#")[0].strip() for line in content.decode("utf-8-sig", "replace").splitlines())
    rows = [[word for word in re.split(r"[,;\s]+", line) if word] for line in lines if line]
    order = [0, 1, 2]
    if rows and set(rows[0]) == set(_COLUMNS):
        order = [rows[0].index(name) for name in _COLUMNS]
        rows = rows[1:]
    try:
        table = np.array([[float(row[column]) for column in order] for row in rows])
    except (ValueError, IndexError):  # words, or too few columns
        table = np.empty((0, 3))
    if len(table) == 0 or not np.isfinite(table).all():
        raise InputError(f"{path}: must be rows of three numbers: {', '.join(_COLUMNS)}")
    angles, columns = np.unique(table[:, 0], return_inverse=True)
    waves, places = np.unique(table[:, 1], return_inverse=True)
    pairs, count = {*zip(columns.tolist(), places.tolist(), strict=True)}, len(angles) * len(waves)
    if not len(pairs) == len(table) == count:
        raise InputError(
            f"{path}: {len(table)} rows for {len(angles)} angles and {len(waves)} wavelengths; must be one a pair"
        )
    values = np.empty((len(waves), len(angles)))
    values[places, columns] = table[:, 2]
    return angles.tolist(), waves.tolist(), values.tolist()
