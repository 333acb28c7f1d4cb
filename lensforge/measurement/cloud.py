"""Points measured on a surface: a text file of x, y, z in mm."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError

LEAST_POINTS = 100


def read_cloud(path: Path) -> Float[np.ndarray, "n 3"]:
    """Points (mm) of a text file: x, y, z first in each line, parted by commas, semicolons, tabs or blanks.

    A header line, lines that begin with # and further columns are passed over. Raises :class:`InputError`.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as text ({error})") from None
    points: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        fields = line.replace(",", " ").replace(";", " ").split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            points.append([float(entry) for entry in fields[:3]])
        except ValueError:
            if points:
                raise InputError(f"{path}: line {number}: {line.strip()[:40]!r}: must be x, y, z in mm") from None
            continue
        if len(points[-1]) < 3:
            raise InputError(f"{path}: line {number}: {len(fields)} numbers, must be x, y, z in mm")
    cloud = np.array(points, dtype=np.float64).reshape(-1, 3)
    if len(cloud) < LEAST_POINTS:
        raise InputError(f"{path}: {len(cloud)} points, must be at least {LEAST_POINTS}")
    if not np.isfinite(cloud).all():
        raise InputError(f"{path}: some points are not finite; remove them")
    return cloud
