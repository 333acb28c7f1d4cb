"""Summary of a source: its power and symmetry, the ray files that were loaded, and their placement."""

import numpy as np
from jaxtyping import Float

from lensforge.results import Count, NotNegative, Number, Point, Positive, Record, Share, Text

Range = tuple[Positive, Positive]


class IndexRange(Record):
    """Least and largest wavelength (nm) of some light, and the refractive index of the lens at each.

    None if one index is taken for all light. ``extrapolated_index_share`` of the flux has wavelengths beyond those
    at which the index was measured, ``clamped_index_share`` even beyond the trusted range, or none that is usable; its
    rays have the index at the end of that range, or at the mean wavelength.
    """

    wavelengths_nm: Range | None = None
    refractive_indices: Range | None = None
    extrapolated_index_share: Share | None = None
    clamped_index_share: Share | None = None

    def fields(self) -> dict[str, object]:
        """The four fields, by name."""
        return {name: getattr(self, name) for name in IndexRange.model_fields}


class RaysDropped(Record):
    """Rows of a file that are no rays, by cause."""

    not_finite: Count
    zero_direction: Count
    no_flux: Count


class LoadedRayFile(IndexRange):
    """Ray file as loaded: rays in the file, rays dropped, and the power ``flux_w`` that its rays carry."""

    file: Text
    format: Text
    rays: Count
    rays_dropped: RaysDropped
    effective_rays: NotNegative
    file_flux: Number | None
    file_ray_sum: Number
    file_flux_unit: Text
    flux_w: Positive
    virtual_focus_mm: Point | None
    warnings: tuple[Text, ...] = ()


class AppliedPlacement(Record):
    """The placement as applied: the point of the file that became the lens origin.

    Also the shares of the flux that miss the lens from the start: ``backward_share`` goes towards -z,
    ``below_plane_share`` starts below z = 0.
    """

    origin_mm: Point
    backward_share: Share
    below_plane_share: Share


class SourceSummary(IndexRange):
    """Source of a design: its power, its mirror symmetry, and for a ray set the files and their placement.

    ``lumens_per_watt``: its luminous efficacy, None if that is not known.
    ``rays``: of all files, dropped ones included; None if a sample may be of any size. ``model``: the radiance that
    draws rays in their place, or why there is none; None if none was asked for.
    """

    title: Text
    flux_w: Positive
    lumens_per_watt: Positive | None = None
    symmetry: Text
    rays: Count | None = None
    effective_rays: NotNegative | None = None
    virtual_focus_mm: Point | None = None
    warnings: tuple[Text, ...] = ()
    files: tuple[LoadedRayFile, ...] = ()
    placement: AppliedPlacement | None = None
    model: Text | None = None

    @property
    def flux_lm(self) -> float | None:
        """Luminous flux (lm); None if the efficacy is not known."""
        return None if self.lumens_per_watt is None else self.flux_w * self.lumens_per_watt


def as_point(coordinates: Float[np.ndarray, " 3"]) -> Point:
    """Convert three coordinates to the tuple that a record holds."""
    x, y, z = coordinates.tolist()
    return x, y, z
