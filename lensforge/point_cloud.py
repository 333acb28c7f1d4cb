"""Points on a surface, measured or given, read from a text file."""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.files import MIB, read_file

LEAST_POINTS = 100
_MOST_BYTES = 128 * MIB  # four million points, which take 1 GiB while they are read; scanners measure a million
# In a line that begins with a number, a comma between digits beside another mark between numbers: 1,5;2,5;3 or 1,5 2,5.
_DECIMAL_COMMAS = re.compile(r"^(?=\s*[-+]?\d)(?:[^#]*\d,\d+[;\s]+[-+]?\d+(?:,\d+|[;\s]|$)|[^#]*;.*\d,\d)")
_FURTHEST_MM = 1e6  # a machine's own zero may be metres away


def read_cloud(path: Path, missing: str = "give the file of the measured points") -> Float[np.ndarray, "n 3"]:
    """Read points (mm) from a text file: x, y, z first in each line, separated by commas, semicolons, tabs or blanks.

    Lines before the first point, lines that begin with # and further columns are skipped. Raises :class:`InputError`,
    for decimal commas too, which show where another mark separates the numbers.
    """
    content = read_file(path, missing=missing, most_bytes=_MOST_BYTES)
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not readable as text ({error})") from None
    points: list[tuple[float, ...]] = []
    skipped = ""
    for number, line in enumerate(lines, start=1):
        fields = line.replace(",", " ").replace(";", " ").split()
        if not fields or fields[0].startswith("#"):
            continue
        if _DECIMAL_COMMAS.search(line):
            raise InputError(f"{path}: line {number}: decimal commas; write decimal points")
        try:
            points.append(tuple(map(float, fields[:3])))
        except ValueError:
            if points:
                raise InputError(f"{path}: line {number}: must be x, y, z in mm") from None
            skipped = skipped or f"line {number}"
            continue
        if len(points[-1]) < 3:
            raise InputError(f"{path}: line {number}: {len(fields)} numbers, must be x, y, z in mm")
    if skipped and not points:
        raise InputError(f"{path}: {skipped}: no line begins with x, y, z in mm; remove names before the numbers")
    cloud = np.array(points, dtype=np.float64).reshape(-1, 3)
    if len(cloud) < LEAST_POINTS:
        raise InputError(f"{path}: {len(cloud)} points, must be at least {LEAST_POINTS}")
    if not np.isfinite(cloud).all():
        raise InputError(f"{path}: some points are not finite; remove them")
    furthest = float(np.abs(cloud).max())
    if furthest > _FURTHEST_MM:
        raise InputError(f"{path}: a coordinate of {furthest:.4g} mm, must be at most {_FURTHEST_MM:g}; remove it")
    return cloud
