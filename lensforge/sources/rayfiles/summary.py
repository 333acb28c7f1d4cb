"""Records about a ray file: its header alone, a summary of its rays, and the result of a conversion."""

from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from pydantic import PrivateAttr

from lensforge.errors import InputError
from lensforge.records import Count, NotNegative, Number, Point, Record, Share, StageResult, Text
from lensforge.sources.rayfiles.plot import Histograms, Panel, draw_panel
from lensforge.sources.rayfiles.rayfile import FluxUnit, HeaderValue, RayFile
from lensforge.sources.source_summary import RaysDropped

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class FileUnits(Record):
    """Units of the summary; ``length_in_file_mm``: the file's own unit of length in mm."""

    length: Literal["mm"] = "mm"
    length_in_file_mm: Number
    flux: FluxUnit


class HeaderFlux(Record):
    """Totals that a header states; ``unit`` is that of the rays."""

    unit: FluxUnit
    header_w: Number | None
    header_lm: Number | None


class FileFlux(HeaderFlux):
    """Flux of the source by header and by rays, in ``unit``; ``total_from``: the one that ``total`` is."""

    total: Number
    total_from: Literal["header", "rays"]
    ray_sum: Number
    ray_sum_over_header: Number | None
    backward_share: Share


class WavelengthRange(Record):
    """Wavelengths (nm); ``mean``: by flux, None where the shares of several spectral tables are unknown."""

    min: Number
    max: Number
    mean: Number | None = None


class Box(Record):
    """Two corners of a box (mm)."""

    min: Point
    max: Point


class RayFileHeader(Record):
    """Header of a ray file alone. ``header``: its fields by the names of its format."""

    format: Text
    title: Text | None
    rays: Count
    units: FileUnits
    flux: HeaderFlux
    wavelengths_nm: WavelengthRange | None
    header: dict[Text, HeaderValue]
    warnings: tuple[Text, ...]


class RayFileSummary(StageResult):
    """Summary of a ray file: header, counts, and statistics of the usable rays; lengths in mm, wavelengths in nm.

    ``effective_rays``: number of rays of equal flux that would have the same noise.
    """

    stage: ClassVar[str] = "rays"
    made_from: ClassVar[tuple[str, ...]] = ()

    format: Text
    title: Text | None
    rays: Count
    units: FileUnits
    rays_used: Count
    rays_dropped: RaysDropped
    effective_rays: NotNegative
    flux: FileFlux
    bounding_box_mm: Box
    virtual_focus_mm: Point | None
    mean_direction: Point
    wavelengths_nm: WavelengthRange | None
    header: dict[Text, HeaderValue]
    warnings: tuple[Text, ...]
    _rayfile: RayFile | None = PrivateAttr(None)

    def holding(self, rayfile: RayFile) -> "RayFileSummary":
        """Attach the rays for :meth:`plot`; they are neither compared nor saved."""
        self._rayfile = rayfile
        return self

    def plot(self, axes: "Axes | None" = None, *, which: Panel = "front") -> "Axes":
        """Plot start points from the front (x, y) or the side (x, z), the forward directions, or the intensity.

        Raises :class:`InputError` for an unknown panel, and for a summary that was read from a file: it has no rays.
        """
        from lensforge.figures.plots import new_axes, require_choice

        require_choice("which", which, get_args(Panel))
        if self._rayfile is None:
            raise InputError("this summary was read back and holds no rays; read the ray file itself again")
        axes = new_axes(axes)
        draw_panel(axes, Histograms.of(self._rayfile), which, self.units.flux)
        return axes

    def _repr_html_(self) -> str:
        """Show start points and the summary as a table in a notebook."""
        return Record._repr_html_(self) if self._rayfile is None else super()._repr_html_()


class Conversion(Record):
    """Conversion of a ray file: formats, size, and the data that the new format could not hold."""

    from_format: Text
    to_format: Text
    rays: Count
    bytes: Count
    lost: tuple[Text, ...]
    warnings: tuple[Text, ...]
