"""Results of the verification: rays through the exported part against the design, and stray light."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float

from lensforge.criteria import Criterion
from lensforge.figures.light_unit import WATTS
from lensforge.records import (
    Array,
    Count,
    Extent,
    Irradiance,
    NotNegative,
    Number,
    Positive,
    Record,
    Share,
    SimulatedResult,
    Text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Gaps = Annotated[Float[np.ndarray, " q"], Array("q")]
LightPath = Literal["sequential", "direct", "stray"]


class LandingDeviation(Record):
    """Distances (mm) between the part's landings and the design's."""

    rms: NotNegative
    max: NotNegative
    p99: NotNegative


class FatePair(Record):
    """Rays that design and part give different fates: both by name, their number and share of the emitted flux."""

    design: Text
    part: Text
    rays: Count
    flux: Share


class Agreement(Record):
    """Distances (mm) between landings of part and design, for rays that both land on the receiver.

    ``flux``: sum of the differences of flux over the sum of flux. ``fates``: number of rays that one lands on the
    receiver and the other loses; ``fates_flux``: their share of the emitted flux; ``pairs``: the same by the fates in
    both, the largest share first. Where no ray lands in both, the distances are the receiver's diagonal and ``flux``
    is 1.
    """

    compared: Count
    rms: NotNegative
    p99: NotNegative
    max: NotNegative
    flux: NotNegative
    fates: Count
    fates_flux: Share
    pairs: tuple[FatePair, ...] = ()


class PlainCast(Record):
    """First hits (``casts``) by trimesh's own ray cast against those of the grid; ``rate``: its casts per second."""

    rays: Count
    casts: Count
    disagreements: Count
    rate: NotNegative


class BrepCast(Record):
    """Rays through the STEP file itself."""

    rays: Count
    seconds: NotNegative
    against_design: Agreement
    against_mesh: Agreement


class MitsubaCast(Record):
    """Rays through the mesh by Mitsuba, release ``version``."""

    version: Text
    rays: Count
    seconds: NotNegative
    nmse_vs_design: NotNegative
    noise_floor_nmse: NotNegative
    nmse_same_rays: NotNegative
    against_design: Agreement


class PartFlux(Record):
    """The flux budget of the part; shares of the emitted flux."""

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    reflected: Share


class PartMissed(Record):
    """Flux that never reaches the receiver's plane, by cause; shares of the emitted flux.

    ``base``: met on the way in or in the body. ``starts_outside``: met the outside of the lens before the inside.
    """

    no_hit: Share
    starts_inside: Share
    starts_outside: Share = 0.0
    base: Share
    back_into_cavity: Share
    missed_receiver: Share


class Proof(SimulatedResult):
    """Rays through the exported part, against the same rays through the design.

    ``irradiance``, ``design_irradiance``: W/m^2 [row y, column x]. ``gaps_*_mm``: quantiles at 0, 0.2 ... 100 % of the
    distances between landings of part and design, by the mesh, the STEP and Mitsuba. ``altered_files``: those whose
    content was not what export.json describes when the rays were cast.
    """

    stage: ClassVar[str] = "verify"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "export", "evaluate")

    rays: Count
    seconds: NotNegative
    cast_seconds: NotNegative
    triangles: Count
    open_edges: Count
    volume_mm3: Number
    facet_height_um: Extent
    nmse_vs_design: NotNegative
    noise_floor_nmse: NotNegative
    nmse_same_rays: NotNegative
    efficiency: Share
    efficiency_design_same_rays: Share
    deviation_mm: LandingDeviation
    deviation_limit_mm: Positive
    rays_compared: Count
    flux_deviation: NotNegative
    fate_disagreements: Count
    fate_disagreement_flux: Share
    fate_pairs: tuple[FatePair, ...] = ()
    altered_files: tuple[Text, ...] = ()
    flux: PartFlux
    missed_by_cause: PartMissed
    plain_cast: PlainCast
    brep: BrepCast | None
    mitsuba: MitsubaCast | None
    criteria: tuple[Criterion, ...]
    irradiance: Irradiance
    design_irradiance: Irradiance
    gaps_mesh_mm: Gaps
    gaps_step_mm: Gaps | None = None
    gaps_mitsuba_mm: Gaps | None = None

    def __str__(self) -> str:
        failed = [str(criterion) for criterion in self.criteria if not criterion.passed]
        deviation = f"{self.deviation_mm.rms:.3g} mm rms, {self.deviation_mm.max:.3g} mm at most"
        verdict = "; ".join(failed) or "every criterion is met"
        return f"part: {self.rays} rays land {deviation} from where the design sends them; {verdict}"

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Cumulative share of the rays over the distance between their landings and the design's."""
        from lensforge.figures.plots import plot_curves

        named = {"exported mesh": self.gaps_mesh_mm, "STEP": self.gaps_step_mm, "Mitsuba": self.gaps_mitsuba_mm}
        curves = {name: (gaps, np.linspace(0.0, 1.0, len(gaps))) for name, gaps in named.items() if gaps is not None}
        return plot_curves(curves, ("distance from the design's landing (mm)", "share of the rays"), axes)


class StrayFlux(Record):
    """Flux budget of the non-sequential trace; shares of the emitted flux, which add up to 1."""

    detected_direct: Share
    detected_stray: Share
    outside_direct: Share
    outside_stray: Share
    backward: Share
    absorbed: Share
    base: Share
    too_dim: Share
    leaked: Share


class StrayByCause(Record):
    """Detected stray light, by the first event that took it off the sequential path."""

    inner_reflection: Share
    outer_reflection: Share
    total_reflection: Share
    base: Share
    met_again: Share


class StraySpread(Record):
    """Position and size (mm) of the stray light on the receiver, and its peak; None where there is none."""

    centroid_mm: tuple[Number, Number] | None
    rms_radius_mm: NotNegative | None
    peak_w_m2: NotNegative
    peak_of_mean: NotNegative | None


class StrayLight(SimulatedResult):
    """Stray light, which the sequential design leaves out: reflections, the base, absorption.

    ``sequential``, ``direct``, ``stray``: irradiance (W/m^2) [row y, column x]. ``misplaced_flux``: flux that lands on
    other pixels than by the sequential trace, as a share of the emitted flux.
    """

    stage: ClassVar[str] = "stray"
    command: ClassVar[str] = "verify --stray"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "export")

    rays: Count
    base: Literal["polished", "black"]
    absorption_per_mm: NotNegative
    cut_off: NotNegative
    depth: Count
    flux: StrayFlux
    balance_error: NotNegative
    detected_stray_by_cause: StrayByCause
    misplaced_flux: NotNegative
    nmse_vs_sequential: NotNegative | None
    spread: StraySpread
    efficiency: Share
    efficiency_sequential: Share
    receiver_mm: Positive
    seconds: NotNegative
    criteria: tuple[Criterion, ...]
    sequential: Irradiance
    direct: Irradiance
    stray: Irradiance

    def plot(self, axes: "Axes | None" = None, *, which: LightPath = "stray") -> "Axes":
        """Irradiance on the receiver (W/m^2): ``which`` part of it. Raises :class:`InputError` for an unknown one."""
        from lensforge.figures.plots import plot_map, require_choice

        require_choice("which", which, get_args(LightPath))
        return plot_map(getattr(self, which), self.receiver_mm, WATTS, axes)
