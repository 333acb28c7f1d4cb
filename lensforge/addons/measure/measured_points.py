"""The measured points of one face of a lens: read from files, apart from those of its other faces."""

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.results.files import MIB
from lensforge.scene.lens import Lens
from lensforge.surfaces.point_files import FaceOfPart, read_cloud

_FITS = (0.8, 1.25)  # median distance of the points over the face's
_FITS_NOT = (0.5, 2.0)  # beyond the second: not it
_LEAST_PARTS = 2
_MOST_PARTS = 200
_MOST_BYTES = 256 * MIB  # of all parts together: eight million points
_EXAMPLE = "cavity3_part12.csv"


@dataclass(frozen=True)
class PartPoints:
    """Points (mm) of one part, the name of their file, and the cavity of the part."""

    cloud: Float[np.ndarray, "n 3"]
    name: str = ""
    cavity: str = ""


def measured_parts(path: Path, lens: Lens, side: str) -> list[PartPoints]:
    """Points of the face ``side``: of the part of a file, or of all parts of a folder, by cavity.

    Files of a folder are called CAVITY_PART: what stands before the last underscore is the cavity. Where no name has an
    underscore, all are of one. Raises :class:`InputError` as :func:`measured_points` does, and for a folder that is no
    series.
    """
    if not path.is_dir():
        return [PartPoints(measured_points(path, lens, side))]
    files = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    _require_series(path, files)
    parts = [PartPoints(measured_points(file, lens, side), file.name, file.stem.rpartition("_")[0]) for file in files]
    for first, second in combinations(parts, 2):
        if np.array_equal(first.cloud, second.cloud):
            raise InputError(f"{path}: {first.name} and {second.name} hold the same points: are they one part?")
    return sorted(parts, key=lambda part: part.cavity)


def _require_series(path: Path, files: list[Path]) -> None:
    if not _LEAST_PARTS <= len(files) <= _MOST_PARTS:
        raise InputError(
            f"{path}: {len(files)} files of points, must be from {_LEAST_PARTS} to {_MOST_PARTS}, one a part, called "
            f"such as {_EXAMPLE}; give the file itself for one part, which has no scatter and no Cp"
        )
    size = sum(file.stat().st_size for file in files)
    if size > _MOST_BYTES:
        raise InputError(f"{path}: {size / MIB:.0f} MiB of points, must be at most {_MOST_BYTES / MIB:.0f}; thin them")
    unnamed = [file.name for file in files if "_" not in file.stem]
    if unnamed and len(unnamed) < len(files):
        raise InputError(
            f"{path}: {unnamed[0]} states no cavity, {len(files) - len(unnamed)} other files do; call all such as "
            f"{_EXAMPLE}, the cavity before the last underscore, or none"
        )


def measured_points(path: Path, lens: Lens, side: str) -> Float[np.ndarray, "n 3"]:
    """Points (mm) of the face ``side``; from a table of several faces only its rows.

    Raises :class:`InputError` for a file without such points, and for points of another face.
    """
    faces = [face.name for face in lens.body.faces if face.is_optical]
    cloud = read_cloud(path, of=FaceOfPart(side, faces))
    _require_own(cloud, lens, side, [name for name in faces if name != side])
    return cloud


def _require_own(cloud: Float[np.ndarray, "n 3"], lens: Lens, side: str, other_faces: list[str]) -> None:
    """Raise :class:`InputError` if the distance of the points fits another face, and not ``side``."""
    above = cloud[cloud[:, 2] > 0.0]
    if not len(above):
        return
    lengths = np.linalg.norm(above, axis=1)
    ratios = {
        name: float(np.median(lengths / lens.surfaces[name].radius(above / lengths[:, None])))
        for name in (side, *other_faces)
    }
    like = next((name for name in other_faces if _FITS[0] <= ratios[name] <= _FITS[1]), None)
    if like is not None and not _FITS_NOT[0] <= ratios[side] <= _FITS_NOT[1]:
        measured = float(np.median(lengths))
        raise InputError(
            f"points: half of them lie within {measured:.3g} mm of the origin, {side!r} lies at "
            f"{measured / ratios[side]:.3g} mm, {like!r} at {measured / ratios[like]:.3g} mm: were they measured on "
            f"the other surface? Give --surface {like}"
        )
