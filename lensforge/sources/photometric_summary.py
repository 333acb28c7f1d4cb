"""Summary of a photometric file: what an engineer checks before using it, and its polar diagram.

The diagram is that of data sheets: gamma = 0 downwards, rings of constant candela. A file of light is inspected by its
content: rays, or the far field of a photometric file.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import PrivateAttr

from lensforge.errors import InputError
from lensforge.public import public
from lensforge.results import Count, NotNegative, Number, Record, Share, StageResult, Text
from lensforge.results.arguments import with_known_names
from lensforge.results.figure import Figure
from lensforge.results.plots import Axes, new_axes
from lensforge.sources.intensity import PlaneBeam, TabulatedIntensity, beam_in_plane, plane_profile
from lensforge.sources.light_files import holds_far_field, read_photometric, read_rayfile
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.photometric_file import far_field_warnings
from lensforge.sources.photometric.photometric_io import TITLES

if TYPE_CHECKING:
    from lensforge.sources.ray_file_summary import RayFileSummary


_COLOURS = ("#c0392b", "#2f7fd1")
_RINGS = 5  # at most
_ROUND = (1, 2, 5, 10)  # digits of the step between rings
_STEP_DEG = 30.0


def draw_polar(axes: "Axes", curves: Mapping[str, tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]]) -> None:
    """Draw each curve, signed angles gamma (deg) and intensities (cd), on ordinary ``axes`` with rings and rays."""
    from matplotlib.ticker import MaxNLocator

    largest = max(float(values.max()) for _, values in curves.values())
    rings = MaxNLocator(_RINGS, steps=_ROUND).tick_values(0.0, largest)[1:]
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    for radius in rings:
        axes.plot(radius * np.sin(turn), -radius * np.cos(turn), color="0.85", linewidth=0.7, zorder=0)
        axes.annotate(f"{radius:g}", (0.0, radius), fontsize=7, color="0.45", ha="center", va="bottom")
    for angle in np.deg2rad(np.arange(0.0, 360.0, _STEP_DEG)):
        axes.plot([0.0, rings[-1] * np.sin(angle)], [0.0, -rings[-1] * np.cos(angle)], color="0.9", lw=0.6, zorder=0)
    for (name, (gamma, values)), colour in zip(curves.items(), _COLOURS, strict=False):
        angle = np.deg2rad(gamma)
        axes.plot(values * np.sin(angle), -values * np.cos(angle), color=colour, linewidth=1.8, label=name)
    axes.set(aspect="equal", title="intensity (cd), gamma = 0 downwards", xticks=[], yticks=[])
    axes.set_frame_on(False)
    axes.legend(frameon=False, loc="upper right")


_PLANES = (0.0, 90.0)  # C 0 - C 180 and C 90 - C 270


class FarFieldAngles(Record):
    """Angles of a table: numbers of half-planes C and of angles gamma, and range of gamma (deg)."""

    planes: Annotated[Count, Figure("half-planes C")]
    gammas: Annotated[Count, Figure("angles gamma")]
    first_gamma_deg: Annotated[Number, Figure("first gamma")]
    last_gamma_deg: Annotated[Number, Figure("last gamma")]


class FarFieldPeak(Record):
    """Largest intensity (cd), and the first direction in the table that has it (deg)."""

    intensity_cd: Annotated[NotNegative, Figure("largest intensity")]
    c_deg: Annotated[Number, Figure("which is at C")]
    gamma_deg: Annotated[Number, Figure("and at gamma")]


@public
class PhotometricSummary(StageResult):
    """Summary of a photometric file. What its format does not have is None, 0 or empty.

    ``format``: of the file. ``title``, ``luminaire``, ``maker``, ``catalogue``, ``laboratory``: by the file's words.
    ``edition``: of the standard. ``generated``: by simulation or measurement, by the titles of LM-63-2019. ``issued``:
    date of the data. ``photometric_type``: of its angles. ``symmetry``: ``revolution``, or the largest mirror group of
    the light. ``angles``: number and range of its angles. ``lumens``: integral of the intensities over all directions.
    ``lamp_lumens``: stated flux of the lamps. ``stated_lumens``: stated flux of the luminaire. ``share_above_90``: of
    the flux, at gamma above 90 degrees. ``peak``: largest intensity, and its direction. ``axis_cd``: intensity on the
    axis. ``beam_c0``: beam in the plane C 0 - C 180. ``beam_c90``: beam in the plane C 90 - C 270. ``watts``: electric.
    ``lumens_per_electric_watt``: flux over that. ``opening_diameter_mm``: of a round opening. ``opening_shape``: in
    words. ``opening_mm``: its width, length and height. ``lamps``: each set in words, the first that of the
    intensities.
    """

    stage: ClassVar[str] = "photometric_file"
    command: ClassVar[str] = "rays"
    made_from: ClassVar[tuple[str, ...]] = ()

    format: Text
    title: Text
    luminaire: Text
    maker: Text
    catalogue: Text
    edition: Text
    generated: Text
    laboratory: Text
    issued: Text
    photometric_type: Literal["A", "B", "C"]
    symmetry: Text
    angles: FarFieldAngles
    lumens: Annotated[NotNegative, Figure("flux by intensities")]
    lamp_lumens: Annotated[NotNegative | None, Figure("flux of the lamps", unit="lm")]
    stated_lumens: Annotated[NotNegative | None, Figure("flux as stated", unit="lm")]
    share_above_90: Annotated[Share, Figure("share above gamma 90°")]
    peak: FarFieldPeak
    axis_cd: Annotated[NotNegative, Figure("intensity on the axis")]
    beam_c0: PlaneBeam
    beam_c90: PlaneBeam
    watts: NotNegative | None
    lumens_per_electric_watt: NotNegative | None
    opening_diameter_mm: NotNegative
    opening_shape: Text
    opening_mm: Annotated[tuple[NotNegative, NotNegative, NotNegative], Figure("its sizes")]
    lamps: tuple[Text, ...]
    warnings: tuple[Text, ...]
    _intensity: CandelaTable | None = PrivateAttr(None)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the polar diagram in both planes, gamma = 0 downwards as in data sheets.

        Raises :class:`InputError` for a summary that was read from a file: it has no intensities.
        """
        if self._intensity is None:
            raise InputError("this summary was read back and holds no intensities; read the photometric file again")
        axes = new_axes(axes)
        curves = {f"C{c:.0f} - C{c + 180.0:.0f}": plane_profile(self._intensity, c) for c in _PLANES}
        draw_polar(axes, curves)
        return axes

    def _repr_html_(self) -> str:
        """Show the polar diagram and the summary as a table in a notebook."""
        return Record._repr_html_(self) if self._intensity is None else super()._repr_html_()


_LABELS = ("maker", "catalogue", "edition", "generated", "laboratory", "issued")
_AS_STATED = (*_LABELS, "photometric_type", "lamp_lumens", "stated_lumens")


def summarise_photometric(path: Path) -> PhotometricSummary:
    """Summarise a photometric file. Raises :class:`InputError` if it cannot be used."""
    file = read_photometric(path)
    table = file.intensity
    watts = file.watts if file.watts > 0.0 else None
    lumens = table.flux()
    axis = bool(table.gamma_deg[0] == 0.0)
    plane, angle = np.unravel_index(int(np.argmax(table.values)), table.values.shape)
    summary = PhotometricSummary(
        format=file.format,
        title=TITLES[file.format],
        luminaire=file.title,
        symmetry="revolution" if len(table.c_deg) == 1 else TabulatedIntensity.of(table).symmetry,
        angles=FarFieldAngles(
            planes=max(len(table.c_deg) - 1, 1),
            gammas=len(table.gamma_deg),
            first_gamma_deg=float(table.gamma_deg[0]),
            last_gamma_deg=float(table.gamma_deg[-1]),
        ),
        lumens=lumens,
        share_above_90=1.0 - table.share_up_to(90.0),
        peak=FarFieldPeak(
            intensity_cd=float(table.values.max()),
            c_deg=float(table.c_deg[plane]),
            gamma_deg=float(table.gamma_deg[angle]),
        ),
        axis_cd=table.pole_mean(0.0) if axis else 0.0,
        beam_c0=beam_in_plane(table, _PLANES[0]),
        beam_c90=beam_in_plane(table, _PLANES[1]),
        watts=watts,
        lumens_per_electric_watt=None if watts is None else lumens / watts,
        opening_diameter_mm=file.opening.diameter_mm,
        opening_shape=file.opening.shape,
        opening_mm=(file.opening.width_mm, file.opening.length_mm, file.opening.height_mm),
        lamps=tuple(map(str, file.lamps)),
        warnings=far_field_warnings(file),
        **{name: getattr(file, name) for name in _AS_STATED},
    )
    summary._intensity = table
    return summary


@public
@with_known_names
def rays(file: Path | str) -> "RayFileSummary | PhotometricSummary":
    """Summarise a file of light: statistics of a ray file, or beam and flux of a photometric file.

    Args:
        file: the file, of any format that a spec takes; its content decides, not its name.
    Returns: The summary.
    Raises: :class:`InputError` for a file of no known format.
    Example:
        >>> summary = lf.rays("cad_out/quickstart/lens.ies")
        >>> print(summary.lumens, summary.beam_c0)
    """
    from lensforge.sources.ray_file_statistics import describe

    if not isinstance(file, Path | str):
        raise InputError(f"rays: {type(file).__name__} given; give the path of a ray file")
    path = Path(file)
    return summarise_photometric(path) if holds_far_field(path) else describe(read_rayfile(path))
