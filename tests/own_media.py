"""Media of tests: coated faces, and bodies in which each of some rays has an index or an absorption of its own."""

from dataclasses import replace

import numpy as np

from lensforge.optics.face_roles import CAVITY, OUTSIDE
from lensforge.optics.material import Absorption, IndexTable, Material
from lensforge.optics.media import Coating, FaceCoating, Medium
from lensforge.sources.ray_bundle import RayBundle


def coatings(inner: Coating | None = None, outer: Coating | None = None) -> tuple[FaceCoating, ...]:
    """Coatings of the two faces of a lens."""
    given = ("inner", CAVITY, inner), ("outer", OUTSIDE, outer)
    return tuple(FaceCoating(face, around, coating) for face, around, coating in given if coating is not None)


def with_own(
    rays: RayBundle, body: Medium, indices: np.ndarray | None = None, absorptions: np.ndarray | None = None
) -> tuple[RayBundle, Medium]:
    """``rays`` with a wavelength each, at which ``body`` has exactly these indices and absorptions (1/mm)."""
    waves = np.linspace(400.0, 700.0, len(rays))
    values = np.full(len(rays), body.refractive_index) if indices is None else indices
    table = IndexTable(tuple(waves.tolist()), tuple(values.tolist()))
    absorbing = None if absorptions is None else Absorption(table.wavelengths_nm, tuple(absorptions.tolist()))
    material = Material("of tests", table, (400.0, 700.0), "", None, absorbing)
    return rays.with_wavelengths(waves), replace(body, material=material)
