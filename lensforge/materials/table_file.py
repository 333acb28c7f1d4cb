"""Tables of a material (.csv, .txt): wavelength (nm), index, and internal transmittance over 1 mm or nothing.

Columns are separated by commas, semicolons, tabs or blanks; comments start with ``#``, and one line of names may come
first. Index and transmittance are linear between the rows, the latter in its logarithm.
"""

import re
from pathlib import Path

import numpy as np

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.materials.data import MaterialData
from lensforge.materials.formulas import IndexTable

_MOST_BYTES = 4 * MIB  # ten thousand rows, the most of a spec, have 0.3 MiB
_LEAST_NM = 100.0  # below that are um: no light here is shorter


def read_material_table(path: Path, name: str) -> MaterialData:
    """Read the table at ``path``; ``name``: what the material is called. Raises :class:`InputError`, one line."""
    text = read_file(path, missing="give a table of the index", most_bytes=_MOST_BYTES).decode("utf-8-sig", "replace")
    lines = [line.split("#")[0].strip() for line in text.splitlines()]
    rows = [re.split(r"[,;\s]+", line) for line in lines if line]
    if rows and not _is_number(rows[0][0]):
        rows = rows[1:]  # names
    try:
        table = np.array([[float(word) for word in row if word] for row in rows])
    except ValueError:
        table = np.empty((0, 0))
    if table.ndim != 2 or len(table) < 2 or table.shape[1] not in (2, 3) or not np.isfinite(table).all():
        raise InputError(
            f"{path}: must be two rows at least of wavelength (nm), index and, if known, internal transmittance of 1 mm"
        )
    table = table[np.argsort(table[:, 0])]
    waves = table[:, 0]
    if waves[-1] < _LEAST_NM or (np.diff(waves) <= 0.0).any():
        raise InputError(f"{path}: wavelengths must be in nm, each once; they go from {waves[0]:g} to {waves[-1]:g}")
    if table.shape[1] == 3 and not ((table[:, 2] > 0.0) & (table[:, 2] <= 1.0)).all():
        raise InputError(f"{path}: an internal transmittance must be above 0 and at most 1")
    known = table.shape[1] == 3
    return MaterialData(
        name=name,
        index=IndexTable(tuple(waves.tolist()), tuple(table[:, 1].tolist())),
        range_nm=(float(waves[0]), float(waves[-1])),
        absorption_nm=tuple(waves.tolist()) if known else (),
        absorption_per_mm=tuple((-np.log(table[:, 2]) + 0.0).tolist()) if known else (),
        source=path.name,
    )


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
