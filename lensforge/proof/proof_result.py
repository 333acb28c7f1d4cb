"""Results of rays through the exported part: against the design, by its files and their size, and its stray light."""

from typing import Annotated, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.proof.file_form import FileForm
from lensforge.results import (
    Array,
    BodySize,
    Count,
    Extent,
    Flag,
    Irradiance,
    Metric,
    NotNegative,
    Number,
    Positive,
    Record,
    ResultByLed,
    Share,
    Text,
    stated,
)
from lensforge.results.arguments import require_choice
from lensforge.results.chart import Chart, light_unit
from lensforge.results.criteria import Criteria, criteria_of
from lensforge.results.figure import Criterion, figure
from lensforge.results.plots import Axes, plot_curves, plot_map
from lensforge.results.stage_result import OnPage


class PartFlux(Record):
    """The flux budget of the part; shares of the emitted flux."""

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    event_limit: Share = 0.0
    absorbed: Share = 0.0
    cover_glass: Share = 0.0
    bodies: Share = 0.0
    reflected: Share


class IndependentRays(Record):
    """Light of rays that verification has drawn from the description of the source, not by the design's sampler.

    Sent through the mesh, against the light of the design: ``efficiency`` in the window, with ``efficiency_design``;
    ``nmse_less_noise`` of the picture against the design's, without the noise of either, None where that of the
    design's is not known. Every ray counts in ``flux``.
    """

    rays: Count
    efficiency: Metric
    efficiency_design: Metric
    nmse_less_noise: Metric | None
    flux: PartFlux


class SizedFile(Record):
    """Size of the body in one file; what flat facets may change of it: a height (mm), volume and area, 0 for a STEP."""

    size: BodySize
    chord_mm: NotNegative = 0.0
    facets_mm3: NotNegative = 0.0
    facets_mm2: NotNegative = 0.0


class Sizes(Record):
    """Size of the part in its files, and as exported: the box of that within ``chord_mm`` of the solid's."""

    exported: BodySize
    chord_mm: NotNegative
    mesh: SizedFile
    step: SizedFile | None


Gaps = Annotated[Float[np.ndarray, " q"], Array("q")]


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


class Agreement(LandingDeviation):
    """Landings and light of part and design: distances (mm) over the rays that both land on the receiver.

    ``flux``: sum of the differences of flux over the sum of flux. ``fates``: number of rays that one lands on the
    receiver and the other loses; ``fates_flux``: their share of the emitted flux; ``pairs``: the same by the fates in
    both, the largest share first. Where no ray lands in both, the distances are the receiver's diagonal and ``flux``
    is 1.
    """

    compared: Count
    flux: NotNegative
    fates: Count
    fates_flux: Share
    pairs: tuple[FatePair, ...] = ()


class PlainCast(Record):
    """First hits (``casts``) by trimesh's own ray cast against those of the grid."""

    rays: Count
    casts: Count
    disagreements: Count


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


class OnReceiver(Record):
    """Light on the receiver ``name``, whose chart has ``width`` and ``height``."""

    name: Text
    width: Positive
    height: Positive
    far_field: Flag

    @property
    def chart(self) -> Chart:
        """Size of the maps, for figures."""
        return Chart(self.width, self.height, self.far_field)


class ReceiverProof(OnReceiver):
    """Rays through the exported part on one receiver, against the same rays through the design.

    ``irradiance``, ``design_irradiance``: W/m^2 or W/sr [row y, column
    x]. Distances between landings of part and design are in mm, those of directions at 1 m. ``gaps_*_mm``: their
    quantiles at 0, 0.2 ... 100 %, by the mesh, the STEP and Mitsuba.
    """

    nmse_vs_design: NotNegative
    noise_floor_nmse: NotNegative
    nmse_same_rays: NotNegative
    efficiency: Share
    efficiency_design_same_rays: Share
    against_design: Agreement
    deviation_limit_mm: Positive
    flux: PartFlux
    brep: BrepCast | None
    mitsuba: MitsubaCast | None
    own_rays: IndependentRays | None
    irradiance: Irradiance
    design_irradiance: Irradiance
    gaps_mesh_mm: Gaps
    gaps_step_mm: Gaps | None = None
    gaps_mitsuba_mm: Gaps | None = None


class LampsTogether(Record):
    """The light of all ``lamps`` of a plate on one receiver, through the plate's mesh, against the design's sum."""

    name: Text
    lamps: Count
    rays: Count
    efficiency: Share
    nmse_vs_sum: NotNegative
    noise_floor_nmse: NotNegative


class Proof(ResultByLed):
    """Rays through the exported part, against the same rays through the design, on every receiver.

    Figures that are not of the rays or the mesh are those of the first receiver.

    ``receivers``: the rays on each receiver, in the order of the spec. ``triangles``: of the mesh. ``open_edges``: of
    the mesh; 0 for a closed one. ``volume_mm3``: of the mesh. ``sizes``: of each file, beside the size as exported;
    None where that was not given. ``emission_apart``: largest difference of a moment of the design's rays, as they
    leave the source, from that of rays which verification has drawn, in standard errors; None where it has drawn none.
    ``facet_height_um``: of the mesh's vertices over the design. ``far_facets``: optical facets of the mesh far from
    every face of the design, of a body of more than two. ``altered_files``: those whose content was not what
    export.json describes when the rays were cast. ``plain_cast``: first hits by trimesh's own cast against these.
    ``together``: all lamps through their plate. ``forms``: form of every file of the part, told once, with the first
    LED.
    """

    stage: ClassVar[str] = "verify"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "export", "evaluate")

    others: "tuple[Proof, ...]" = ()
    receivers: Annotated[tuple[ReceiverProof, ...], Field(min_length=1)]
    rays: Count
    seconds: NotNegative
    triangles: Count
    open_edges: Count
    volume_mm3: Number
    sizes: Sizes | None
    emission_apart: NotNegative | None
    facet_height_um: Extent
    far_facets: Count = 0
    altered_files: tuple[Text, ...] = ()
    plain_cast: PlainCast
    together: tuple[LampsTogether, ...] = ()
    forms: tuple[FileForm, ...] = ()
    criteria: Criteria

    @property
    def first(self) -> ReceiverProof:
        """Rays on the first receiver."""
        return self.receivers[0]

    @stated
    def nmse_vs_design(self) -> float:
        """NMSE of the part's light on the first receiver against the design's."""
        return self.first.nmse_vs_design

    @stated
    def noise_floor_nmse(self) -> float:
        """NMSE that the noise of the part's rays explains."""
        return self.first.noise_floor_nmse

    @stated
    def efficiency(self) -> float:
        """Share of the emitted flux in the first receiver's window, through the part."""
        return self.first.efficiency

    @stated
    def deviation_mm(self) -> LandingDeviation:
        """Distances between the part's landings on the first receiver and the design's."""
        return self.first.against_design

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each file that is not as exported: it was judged all the same."""
        by = {True: "geometry and light", False: "geometry"}
        lit = {"lens.step", "lens.stl"}  # rays go through them
        said = "{} is not the file that was exported: judged by its {}"
        return tuple(said.format(name, by[name in lit]) for name in self.altered_files)

    def __str__(self) -> str:
        failed = [str(criterion) for criterion in criteria_of(self) if not criterion.holds]
        deviation = f"{self.deviation_mm.rms:.3g} mm rms, {self.deviation_mm.max:.3g} mm at most"
        verdict = "; ".join(failed) or "every criterion is met"
        landing = f"part: {self.rays} rays, displaced by {deviation} against the design; {verdict}"
        return "; ".join([landing, *self.notes])

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Cumulative share of the rays over the distance between their first landings and the design's."""
        first = self.first
        named = {"exported mesh": first.gaps_mesh_mm, "STEP": first.gaps_step_mm, "Mitsuba": first.gaps_mitsuba_mm}
        curves = {name: (gaps, np.linspace(0.0, 1.0, len(gaps))) for name, gaps in named.items() if gaps is not None}
        return plot_curves(curves, ("ray displacement (mm)", "share of the rays"), axes)


LightPath = Literal["sequential", "direct", "stray"]


class StrayFlux(Record):
    """Flux budget of the non-sequential trace; shares of the emitted flux, which add up to 1."""

    detected_direct: Share
    detected_stray: Share
    outside_direct: Share
    outside_stray: Share
    backward: Share
    absorbed: Share
    cover_glass: Share = 0.0
    bodies: Share = 0.0
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


class ReceiverStray(OnReceiver):
    """Stray light on one receiver.

    ``sequential``, ``direct``, ``stray``: irradiance (W/m^2) or intensity (W/sr)
    [row y, column x]. ``misplaced_flux``: flux that lands on other pixels than by the sequential trace, as a share of
    the emitted flux. ``peak_of_mean``: largest stray light over the mean of the sequential light; None where that is 0.
    """

    flux: StrayFlux
    balance_error: NotNegative
    detected_stray_by_cause: StrayByCause
    misplaced_flux: NotNegative
    nmse_vs_sequential: NotNegative | None
    peak_of_mean: NotNegative | None
    efficiency: Share
    efficiency_sequential: Share
    sequential: Irradiance
    direct: Irradiance
    stray: Irradiance


FINER = "export with a finer mesh: without --rings it is as fine as the light asks"
BALANCE = 1e-9  # shares of flux add up to 1: nothing is drawn at random
LEAK_SHARE = 1e-3  # light that passes through the mesh at an edge
DIM_SHARE = 1e-2  # rays below the flux cut-off: the most that they could still change


class StrayLight(ResultByLed):
    """Stray light, which the sequential design leaves out: reflections, the base, absorption; on every receiver.

    Flux budget and efficiencies are those of the first receiver.

    ``receivers``: the light on each receiver, in the order of the spec. ``base``: polished, or black and absorbing.
    ``lenses``: of the plate, of which one in the middle is lit. ``neighbours``: share of its light that meets another
    of them, above z = 0. ``absorption_per_mm``: of the body. ``cut_off``: share of the mean ray's flux below which a
    ray is followed no further. ``depth``: largest number of faces that a ray meets.
    """

    stage: ClassVar[str] = "stray"
    command: ClassVar[str] = "verify --stray"
    on_page: ClassVar[OnPage] = OnPage("stray light")
    made_from: ClassVar[tuple[str, ...]] = ("lens", "export")

    others: "tuple[StrayLight, ...]" = ()
    receivers: Annotated[tuple[ReceiverStray, ...], Field(min_length=1)]
    rays: Count
    base: Literal["polished", "black"]
    lenses: Count = 1
    neighbours: Share = 0.0
    absorption_per_mm: NotNegative
    cut_off: NotNegative
    depth: Count
    seconds: NotNegative
    criteria: Criteria = ()

    @property
    def first(self) -> ReceiverStray:
        """Light on the first receiver."""
        return self.receivers[0]

    @stated
    def flux(self) -> StrayFlux:
        """Flux budget of the first receiver."""
        return self.first.flux

    @property
    @figure(
        Criterion(
            "<=",
            BALANCE,
            "flux missing from the stray-light budget",
            "do not trust this flux budget, it does not close: please report it",
            name="stray_balance",
            unit="of the flux",
        )
    )
    def balance_error(self) -> float:
        """Share of the flux that is missing from the budget, on the receiver where it is largest."""
        return max(receiver.balance_error for receiver in self.receivers)

    @property
    @figure(
        Criterion(
            "<=",
            LEAK_SHARE,
            "flux that leaks through the edges of the mesh",
            FINER,
            name="stray_leaked",
            unit="of the flux",
        )
    )
    def leaked(self) -> float:
        """Share of the flux that leaks."""
        return self.flux.leaked

    @property
    @figure(
        Criterion(
            "<=",
            DIM_SHARE,
            "flux still in the part at the cut-off",
            "light is trapped in the part: state lens.absorption_per_mm of the material, or "
            "blacken the base (verify --stray --base black)",
            name="stray_too_dim",
            unit="of the flux",
        )
    )
    def too_dim(self) -> float:
        """Share of the flux that was not followed to its end."""
        return self.flux.too_dim

    @stated
    def efficiency(self) -> float:
        """Share of the emitted flux in the first receiver's window, reflections included."""
        return self.first.efficiency

    @stated
    def efficiency_sequential(self) -> float:
        """Share of the emitted flux in the first receiver's window, without reflections."""
        return self.first.efficiency_sequential

    def plot(self, axes: "Axes | None" = None, *, which: LightPath = "stray", receiver: str | None = None) -> "Axes":
        """Light on a receiver, by default the first (W/m^2 or W/sr): ``which`` part.

        Raises :class:`InputError` for an unknown part or receiver.
        """
        require_choice("which", which, get_args(LightPath))
        named = {each.name: each for each in self.receivers}
        if receiver is not None:
            require_choice("receiver", receiver, named)
        shown = self.first if receiver is None else named[receiver]
        return plot_map(getattr(shown, which), shown.chart, light_unit(None, far_field=shown.far_field), axes)
