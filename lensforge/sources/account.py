"""What a source is and what was done to its rays: the account that a design keeps of its light."""

from typing import Literal

from lensforge.records import Count, NotNegative, Number, Point, Positive, Record, Share, Text

Range = tuple[Positive, Positive]


class RaysDropped(Record):
    """Rows of a file that are no rays, by cause."""

    not_finite: Count
    zero_direction: Count
    no_flux: Count


class FileAccount(Record):
    """One ray file: what it holds, what was left out of it, and the power that it was given.

    ``wavelengths_nm``: the least and the largest, ``refractive_indices``: of the lens there; None where one index is
    taken for all light.
    """

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
    wavelengths_nm: Range | None = None
    refractive_indices: Range | None = None


class PlacementAccount(Record):
    """How measured rays came to lie in lens coordinates, and which share of them can be of no use.

    ``origin_mm``: the point of the file that became the lens origin.
    """

    origin_mm: Point
    scale: Positive
    axis: Text
    mirror: Literal["none", "x", "y"]
    rotate_z_deg: Number
    backward_share: Share
    below_plane_share: Share


class SourceAccount(Record):
    """What emits: its power, its mirror symmetry, and of measured rays their files and placement.

    ``rays``: of all files, what was left out included; None for a source that can be sampled without end.
    ``wavelengths_nm`` and ``refractive_indices`` as in :class:`FileAccount`, of all light.
    """

    title: Text
    flux_w: Positive
    symmetry: Text
    rays: Count | None = None
    effective_rays: NotNegative | None = None
    virtual_focus_mm: Point | None = None
    warnings: tuple[Text, ...] = ()
    wavelengths_nm: Range | None = None
    refractive_indices: Range | None = None
    files: tuple[FileAccount, ...] = ()
    placement: PlacementAccount | None = None
