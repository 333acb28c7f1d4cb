"""Result of the photometry: the light of the lens as IES, EULUMDAT, TM-33 and TM-25 files, and the flux they hold."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float

from lensforge.criteria import Criterion, at_most
from lensforge.far_field.beam_figures import Direction, PlaneFigures
from lensforge.files import MIB
from lensforge.records import (
    Array,
    Count,
    Extent,
    Flag,
    InFile,
    Metric,
    NotNegative,
    Positive,
    Record,
    SimulatedResult,
    Text,
)
from lensforge.roadway.road_figures import RoadFigures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

IES_FILE, LDT_FILE, TM33_FILE, TM25_FILE = "lens.ies", "lens.ldt", "lens.iesxml", "lens.tm25ray"
_CONSERVED = 1e-5  # relative error of a file's integral: seven digits of each number are written


class WrittenFile(Record):
    """One file as read back: its flux, in lumens, in watts or in both, and the relative error from the rays' flux."""

    lumens: NotNegative | None = None
    watts: NotNegative | None = None
    rays: Count | None = None
    relative_error: NotNegative


class WrittenFiles(Record):
    """The four files as read back."""

    ies: WrittenFile
    ldt: WrittenFile
    tm33: WrittenFile
    tm25ray: WrittenFile


def photometry_criteria(files: WrittenFiles) -> tuple[Criterion, ...]:
    """One criterion for each file: it holds the flux of the rays."""
    named = (
        (IES_FILE, files.ies),
        (LDT_FILE, files.ldt),
        (TM33_FILE, files.tm33),
        (TM25_FILE, files.tm25ray),
    )
    unit, remedy = "relative", "please report the lens.json"
    return tuple(
        at_most(f"flux of {name} as read back", found.relative_error, _CONSERVED, unit, remedy) for name, found in named
    )


class LostFlux(Record):
    """Flux (W) that does not leave the lens upwards, by fate."""

    backward: NotNegative
    outside_cavity: NotNegative
    base: NotNegative
    total_reflection: NotNegative
    not_converged: NotNegative
    surfaces_intersect: NotNegative
    missed_receiver: NotNegative
    absorbed: NotNegative = 0.0
    cover_glass: NotNegative = 0.0


class Photometry(SimulatedResult):
    """The light that leaves the lens upwards. ``lost_w``: the rest by fate; ``reflected_w``: lost at the surfaces.

    ``candela`` at the angles ``c_deg`` and ``gamma_deg``: gamma = 0 is the lens axis, C = 0 the x axis, C = 90 the
    -y axis. The table is bilinear between them, and fitted to the flux of the rays; ``candela_standard_error`` is the
    standard error of each of its numbers by independent samples of the rays, 0 where there was only one sample.
    ``node_error`` is the same relative to the intensity, where that is above a tenth of the peak: the largest, and the
    root mean square over solid angle; ``interpolation_error``: rms of what a table of half the steps would add there,
    relative to the peak, with its own standard error on top. ``peak_cd`` has the noise taken off by which the largest
    of many numbers is too large; ``peak_direction``: node with the largest. ``beam_c0``, ``beam_c90``: in the principal
    planes. ``road``: of a lamp, where the spec says that it is for an area or a road.

    ``source_lm_from``: where the luminous flux of the source comes from. Where nothing states it, ``per_1000_lm`` is
    true: ``source_lm`` is 1000, and candela are per 1000 lm of the source. ``warnings``: whatever limits the use of the
    files. ``ies``, ``ldt``, ``tm33``, ``tm25``: the bytes of the files.
    """

    stage: ClassVar[str] = "photometry"

    rays: Count
    source_w: Positive
    exit_w: Metric
    light_output_ratio: Metric
    lost_w: LostFlux
    reflected_w: NotNegative
    source_lm: Positive
    source_lm_from: Literal["given", "spec or source file", "not known"]
    per_1000_lm: Flag
    exit_lm: Metric
    axis_cd: Metric
    peak_cd: Metric
    peak_direction: Direction
    beam_c0: PlaneFigures
    beam_c90: PlaneFigures
    road: RoadFigures | None
    node_error: Extent | None
    interpolation_error: NotNegative | None
    warnings: tuple[Text, ...] = ()
    files: WrittenFiles
    seconds: NotNegative
    criteria: tuple[Criterion, ...]
    c_deg: Annotated[Float[np.ndarray, " c"], Array("c")]
    gamma_deg: Annotated[Float[np.ndarray, " g"], Array("g")]
    candela: Annotated[Float[np.ndarray, "c g"], Array("c", "g")]
    candela_standard_error: Annotated[Float[np.ndarray, "c g"], Array("c", "g")]
    ies: Annotated[bytes, InFile(IES_FILE)]
    ldt: Annotated[bytes, InFile(LDT_FILE)]
    tm33: Annotated[bytes, InFile(TM33_FILE)]
    tm25: Annotated[bytes, InFile(TM25_FILE, 1024 * MIB)]  # 38 million rays

    def products(self) -> dict[str, bytes]:
        """Bytes of the IES, EULUMDAT, TM-33 and TM-25 files, by suffix."""
        return {".ies": self.ies, ".ldt": self.ldt, ".iesxml": self.tm33, ".tm25ray": self.tm25}

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot candela over the angle from the axis, in the planes C = 0 and C = 90 degrees."""
        from lensforge.figures.plots import plot_curves

        planes = {f"C = {wanted:g}°": int(np.argmin(np.abs(self.c_deg - wanted))) for wanted in (0.0, 90.0)}
        curves = {name: (self.gamma_deg, self.candela[row]) for name, row in planes.items()}
        return plot_curves(curves, ("gamma (degrees)", "intensity (cd)"), axes)
