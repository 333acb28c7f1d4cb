"""Result of the photometry: the light of the lens as IES, EULUMDAT and TM-25 files, and the flux that they hold."""

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from jaxtyping import Float

from lensforge.criteria import Criterion
from lensforge.records import Array, Count, InFile, Metric, NotNegative, Positive, Record, StageResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

IES_FILE, LDT_FILE, TM25_FILE = "lens.ies", "lens.ldt", "lens.tm25ray"


class WrittenFile(Record):
    """One file as read back: its flux, in lumens or in watts, and the relative error from the rays' flux."""

    lumens: NotNegative | None = None
    watts: NotNegative | None = None
    rays: Count | None = None
    relative_error: NotNegative


class WrittenFiles(Record):
    """The three files as read back."""

    ies: WrittenFile
    ldt: WrittenFile
    tm25ray: WrittenFile


class LostFlux(Record):
    """Flux (W) that does not leave the lens upwards, by fate."""

    backward: NotNegative
    outside_cavity: NotNegative
    base: NotNegative
    total_reflection: NotNegative
    not_converged: NotNegative
    surfaces_intersect: NotNegative
    missed_receiver: NotNegative


class Photometry(StageResult):
    """The light that leaves the lens upwards. ``lost_w``: the rest by fate; ``reflected_w``: lost at the surfaces.

    ``candela`` at the angles ``c_deg`` and ``gamma_deg``: gamma = 0 is the lens axis, C = 0 the x axis, C = 90 the y
    axis. ``ies``, ``ldt``, ``tm25``: the bytes of the files.
    """

    stage: ClassVar[str] = "photometry"

    rays: Count
    source_w: Positive
    exit_w: Metric
    light_output_ratio: Metric
    lost_w: LostFlux
    reflected_w: NotNegative
    source_lm: Positive
    exit_lm: NotNegative
    peak_cd: NotNegative
    files: WrittenFiles
    seconds: NotNegative
    criteria: tuple[Criterion, ...]
    c_deg: Annotated[Float[np.ndarray, " c"], Array("c")]
    gamma_deg: Annotated[Float[np.ndarray, " g"], Array("g")]
    candela: Annotated[Float[np.ndarray, "c g"], Array("c", "g")]
    ies: Annotated[bytes, InFile(IES_FILE)]
    ldt: Annotated[bytes, InFile(LDT_FILE)]
    tm25: Annotated[bytes, InFile(TM25_FILE)]

    def products(self) -> dict[str, bytes]:
        """Bytes of the IES, EULUMDAT and TM-25 files, by suffix."""
        return {".ies": self.ies, ".ldt": self.ldt, ".tm25ray": self.tm25}

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot candela over the angle from the axis, in the planes C = 0 and C = 90 degrees."""
        from lensforge.figures.plots import plot_curves

        planes = {f"C = {wanted:g}°": int(np.argmin(np.abs(self.c_deg - wanted))) for wanted in (0.0, 90.0)}
        curves = {name: (self.gamma_deg, self.candela[row]) for name, row in planes.items()}
        return plot_curves(curves, ("gamma (degrees)", "intensity (cd)"), axes)
