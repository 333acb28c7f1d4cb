"""The keep-out: solids of a STEP file (LED package, bond wires, board) that a lens and its base must not enter.

The file is in the coordinates of the lens. It comes from outside, and is read in a child process as a custom base is.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad_files.step_reading import parse_apart
from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.geometry.custom_base import tessellated
from lensforge.geometry.keep_out_error import FACET_MM
from lensforge.geometry.solid import Solid
from lensforge.untrusted.archives import MOST_STEP_MIB

_CHORD_MM = 0.5 * FACET_MM
_REMEDY = "repair it in CAD, and export it as AP203, AP214 or AP242"


@dataclass(frozen=True, eq=False)
class KeepOutSolid:
    """A closed mesh of one solid: vertices (mm), and triangles that face outwards."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]

    @property
    def corners(self) -> Float[np.ndarray, "t 3 3"]:
        """Corners (mm) of every triangle."""
        found: Float[np.ndarray, "t 3 3"] = self.vertices[self.triangles]
        return found


@dataclass(frozen=True, eq=False)
class KeepOut:
    """The solids of a file, as meshes within ``FACET_MM`` of their faces."""

    path: Path
    solids: tuple[KeepOutSolid, ...]


def read_keep_out(path: Path) -> KeepOut:
    """The solids of the STEP file ``path``, whatever its unit in mm; the same object for the same content.

    Raises :class:`InputError` for a file that is not there, is not STEP, or holds no valid solid.
    """
    missing = "constraints.keep_out is relative to the folder of its spec"
    return _meshed(read_file(path, missing=missing, most_bytes=MOST_STEP_MIB * MIB), path)


@lru_cache(maxsize=2)
def _meshed(content: bytes, path: Path) -> KeepOut:
    parts = parse_apart(content, str(path), _REMEDY, to_be_joined=True)
    solids = [Solid(shape, {}) for part in parts for shape in part.shape.Solids()]
    if not solids:
        raise InputError(f"{path}: holds no solid, a keep-out is one or several; export closed bodies, not surfaces")
    for number, solid in enumerate(solids, start=1):
        if not solid.valid:
            raise InputError(
                f"{path}: its solid {number} of {len(solids)} is not valid (open, hollow, or self-intersecting); "
                "repair it in CAD"
            )
    return KeepOut(path, tuple(KeepOutSolid(*tessellated(solid, _CHORD_MM)) for solid in solids))
