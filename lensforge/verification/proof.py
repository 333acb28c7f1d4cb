"""The results of the verification: does the exported part send every ray where the design does, and stray light."""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float

from lensforge.figures.light_unit import WATTS
from lensforge.gates import Gate
from lensforge.records import (
    Array,
    Count,
    Extent,
    NotNegative,
    Number,
    Positive,
    Record,
    Share,
    StageResult,
    Text,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Image = Annotated[Float[np.ndarray, "p p"], Array("p", "p")]
Gaps = Annotated[Float[np.ndarray, " q"], Array("q")]
Picture = Literal["sequential", "direct", "stray"]


class Deviation(Record):
    """How far from the design's landings the part's are (mm)."""

    rms: NotNegative
    max: NotNegative
    p99: NotNegative


class Agreement(Record):
    """How far apart part and design land the rays that both put on the receiver; lengths in mm.

    ``flux``: sum of the differences of flux over the sum of flux. ``fates``: number of rays that one puts on the
    receiver and the other loses; ``fates_flux``: their share of the emitted flux. Where no ray lands in both there is
    nothing to compare: then the lengths are the receiver's diagonal and ``flux`` is 1.
    """

    compared: Count
    rms: NotNegative
    p99: NotNegative
    max: NotNegative
    flux: NotNegative
    fates: Count
    fates_flux: Share


class PlainCast(Record):
    """``casts`` first hits of ``rays`` rays by trimesh's plain path; ``rate``: its casts per second."""

    rays: Count
    casts: Count
    disagreements: Count
    rate: NotNegative


class BrepCast(Record):
    """``rays`` rays through the STEP itself."""

    rays: Count
    seconds: NotNegative
    against_design: Agreement
    against_mesh: Agreement


class MitsubaCast(Record):
    """``rays`` rays through the mesh by Mitsuba of ``version``."""

    version: Text
    rays: Count
    seconds: NotNegative
    nmse_vs_design: NotNegative
    noise_floor_nmse: NotNegative
    nmse_same_rays: NotNegative
    against_design: Agreement


class PartFlux(Record):
    """The flux budget of the part; shares of what is emitted."""

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    absorbed_fresnel: Share


class PartMissed(Record):
    """Of the flux that missed the receiver's plane: why."""

    no_hit: Share
    starts_inside: Share
    base: Share
    back_into_cavity: Share
    averted: Share


class Proof(StageResult):
    """The exported part under rays, against the design under the same rays.

    ``irradiance``, ``design_irradiance``: W/m^2 [row y, column x]. ``gaps_*_mm``: the landing gaps below which 0, 0.2
    ... 100 % of the rays lie, by the mesh, the STEP and Mitsuba.
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
    deviation_mm: Deviation
    deviation_limit_mm: Positive
    rays_compared: Count
    flux_deviation: NotNegative
    fate_disagreements: Count
    fate_disagreement_flux: Share
    flux: PartFlux
    missed_by_cause: PartMissed
    referee: PlainCast
    brep: BrepCast | None
    mitsuba: MitsubaCast | None
    gates: tuple[Gate, ...]
    irradiance: Image
    design_irradiance: Image
    gaps_mesh_mm: Gaps
    gaps_step_mm: Gaps | None = None
    gaps_mitsuba_mm: Gaps | None = None

    def __str__(self) -> str:
        failed = [str(gate) for gate in self.gates if not gate.passed]
        deviation = f"{self.deviation_mm.rms:.3g} mm rms, {self.deviation_mm.max:.3g} mm at most"
        verdict = "; ".join(failed) or "every gate holds"
        return f"part: {self.rays} rays land {deviation} from where the design sends them; {verdict}"

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Share of the rays that land no farther than a distance from where the design sends them."""
        from lensforge.figures.plots import plot_curves

        named = {"exported mesh": self.gaps_mesh_mm, "STEP": self.gaps_step_mm, "Mitsuba": self.gaps_mitsuba_mm}
        curves = {name: (gaps, np.linspace(0.0, 1.0, len(gaps))) for name, gaps in named.items() if gaps is not None}
        return plot_curves(curves, ("distance from the design's landing (mm)", "share of the rays"), axes)


class StrayFlux(Record):
    """Where all of the light ends; shares of what is emitted, which add up to 1."""

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
    """Stray light that is detected, by what first took it off the way that the sequential design knows."""

    inner_reflection: Share
    outer_reflection: Share
    total_reflection: Share
    base: Share
    met_again: Share


class StraySpread(Record):
    """Where on the receiver the stray light lands (mm), and how bright it is there; None where there is none."""

    centroid_mm: tuple[Number, Number] | None
    rms_radius_mm: NotNegative | None
    peak_w_m2: NotNegative
    peak_of_mean: NotNegative | None


class StrayLight(StageResult):
    """What the sequential design leaves out: reflections, the base, absorption.

    ``sequential``, ``direct``, ``stray``: irradiance (W/m^2) [row y, column x].
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
    misjudged_flux: NotNegative
    nmse_vs_sequential: NotNegative | None
    spread: StraySpread
    efficiency: Share
    efficiency_sequential: Share
    receiver_mm: Positive
    seconds: NotNegative
    gates: tuple[Gate, ...]
    sequential: Image
    direct: Image
    stray: Image

    def plot(self, axes: "Axes | None" = None, *, which: Picture = "stray") -> "Axes":
        """One of the pictures on the receiver, in W/m^2. Raises :class:`InputError` for an unknown one."""
        from lensforge.figures.plots import plot_map, require_choice

        require_choice("which", which, get_args(Picture))
        return plot_map(getattr(self, which), self.receiver_mm, WATTS, axes)
