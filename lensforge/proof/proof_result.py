"""Results of rays through the exported part: against the design, by its files and their size, and its stray light."""

from collections.abc import Iterator, Mapping
from math import hypot
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from lensforge.proof.acceptance import (
    DEVIATION_RAD,
    ELSEWHERE,
    EMITTED_OTHERWISE,
    ERRORS,
    FATE_SHARE,
    FINE_FACETS_UM,
    FLUX_SHARE,
    INWARDS,
    MOST_APART,
    NOISE_ALLOWANCE,
    OTHER_LIGHT,
    SAME_RAYS_ALLOWANCE,
    SAME_RAYS_FLOORS,
    brep_criteria,
    brep_evidence,
    cast_criteria,
    mitsuba_criteria,
    noise_limit,
    size_criteria,
    size_mismatch,
)
from lensforge.proof.cast_results import (
    Agreement,
    BrepCast,
    Gaps,
    LandingDeviation,
    MitsubaCast,
    PartFlux,
    PlainCast,
    Sizes,
)
from lensforge.proof.file_form import FileForm
from lensforge.proof.remedies import FINER, Evidence, form_of_mesh
from lensforge.public import public
from lensforge.results import (
    Count,
    Extent,
    Fact,
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
from lensforge.results.case import Case
from lensforge.results.chart import Chart, light_unit
from lensforge.results.criteria import Criteria, under
from lensforge.results.figure import Criterion, Figure, criteria_in, figure
from lensforge.results.numerals import number, percent, quantity
from lensforge.results.plots import Axes, plot_curves, plot_map
from lensforge.results.stage_result import OnPage


class IndependentRays(Record):
    """Light of rays that verification has drawn from the description of the source, not by the design's sampler.

    Sent through the mesh, against the light of the design: ``efficiency`` in the window, with ``efficiency_design``;
    ``nmse_less_noise`` of the picture against the design's, without the noise of either, None if the design's noise is
    not known. Every ray counts in ``flux``.
    """

    rays: Count
    efficiency: Metric
    efficiency_design: Metric
    nmse_less_noise: Annotated[
        Metric | None,
        Criterion(
            "<=",
            lambda proof, receiver: receiver.own_rays.nmse_limit,
            "pattern of independent rays, against the design",
            OTHER_LIGHT,
            name="own_rays_nmse",
            of="value",
            unit="",
        ),
    ]
    flux: PartFlux

    @property
    @figure(
        Criterion(
            "<=",
            lambda proof, receiver: receiver.own_rays.efficiency_limit,
            "efficiency of independent rays",
            OTHER_LIGHT,
            name="own_rays_efficiency",
            unit="of the flux",
        )
    )
    def efficiency_apart(self) -> float:
        """Distance of the efficiency from the design's."""
        return abs(self.efficiency.value - self.efficiency_design.value)

    @property
    def efficiency_limit(self) -> float:
        """The largest distance that noise explains."""
        errors = (self.efficiency.standard_error, self.efficiency_design.standard_error)
        return FLUX_SHARE + ERRORS * hypot(*(error or 0.0 for error in errors))

    @property
    def nmse_limit(self) -> float | None:
        """The largest NMSE that noise explains; None if it is not known."""
        seen = self.nmse_less_noise
        return None if seen is None else NOISE_ALLOWANCE + ERRORS * (seen.standard_error or 0.0)


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

    against_design: Annotated[
        Agreement,
        Figure(
            "Ray displacement",
            lambda proof, receiver: f"rms, {receiver.displacement_words}",
            key="landing",
            of="rms_mm",
            unit="µm",
            digits=2,
            limit=lambda proof, receiver: 1e3 * receiver.deviation_limit_mm,
            judged_by="deviation_rms",
        ),
    ]
    nmse_vs_design: Annotated[
        NotNegative,
        Figure("NMSE against the design", "of the part; ray noise alone: {noise_floor_nmse:3}", digits=3),
        Criterion(
            "<=",
            lambda proof, receiver: noise_limit(receiver.noise_floor_nmse),
            "pattern of the mesh (lens.stl), against the design",
            lambda proof, receiver: _noise_or_mesh(proof, receiver),
        ),
    ]
    noise_floor_nmse: NotNegative
    nmse_same_rays: Annotated[
        NotNegative,
        Figure("NMSE with the same rays", digits=3),
        Criterion(
            "<=",
            "same_rays_limit",
            "pattern of the mesh (lens.stl), against the design, same rays",
            lambda proof, receiver: _mesh_evidence(proof, receiver).of_pixels(),
        ),
    ]
    efficiency: Annotated[
        Share,
        Figure(
            "Efficiency of the part",
            "the same rays through the design: {designed_words}",
            key="part_efficiency",
            unit="%",
        ),
    ]
    efficiency_design_same_rays: Share
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

    @property
    def reach_mm(self) -> float:
        """Displacement on the receiver per radian at the lens; of its limit on the deviation."""
        return self.deviation_limit_mm / DEVIATION_RAD

    @property
    def same_rays_limit(self) -> float:
        """The largest NMSE by the same rays."""
        return SAME_RAYS_FLOORS * self.noise_floor_nmse + SAME_RAYS_ALLOWANCE

    @property
    def designed_words(self) -> str:
        """Display text of the design's efficiency by the same rays."""
        return percent(self.efficiency_design_same_rays, 4)

    @property
    def displacement_words(self) -> str:
        """Display text of place and size of the largest displacement of rays."""
        at = "at 1 m, " if self.far_field else ""
        return f"{at}part against design; at most {quantity(1e3 * self.against_design.max, 'µm', digits=2)}"


def _pattern_of_all(lamps: str, mesh: str, *, on_plate: bool) -> Criterion:
    """The limit on the pattern of all lamps, on a plate or apart."""
    file = "plate.stl" if on_plate else "lens.stl"
    return Criterion(
        "<=",
        lambda proof, together: noise_limit(together.noise_floor_nmse) if proof.on_plate == on_plate else None,
        f"pattern of all lamps through {mesh}, against their sum",
        f"verify with more rays, or export again: {file} is not the lens of lens.json at its places",
        name=f"{lamps}_nmse_vs_sum",
    )


class LampsTogether(Record):
    """The light of all ``lamps`` of a plate on one receiver, through the plate's mesh, against the design's sum."""

    name: Text
    lamps: Count
    rays: Count
    nmse_vs_sum: Annotated[
        NotNegative,
        Figure("NMSE against the sum", "ray noise alone: {noise_floor_nmse:3}", key="nmse_vs_sum", digits=3),
        _pattern_of_all("plate", "plate.stl", on_plate=True),
        _pattern_of_all("lamps", "the mesh (lens.stl) of each", on_plate=False),
    ]
    efficiency: Annotated[
        Share,
        Figure(
            lambda proof, lamps: "Efficiency of the plate" if proof.on_plate else "Efficiency of all lamps",
            "through its mesh",
            key="plate_efficiency",
            unit="%",
        ),
    ]
    noise_floor_nmse: NotNegative


class BodyLightProof(Record):
    """Light on the body ``name`` of the scene, by rays that verification has drawn and walks of its own.

    ``mean``: over its surface, ``least``: on the patch that is darkest by the design (W/m²). ``apart``: mean square
    distance from the light of the design, in standard errors, over ``groups`` of neighbouring patches that should have
    ten rays each. ``in_dark``: share of the emitted flux on patches that are dark by the design.
    """

    name: Text
    rays: Count
    mean: Annotated[Metric, Figure("Mean on {name}", "the design’s: {mean_design:4}", key="body_mean")]
    mean_design: NotNegative
    least: Annotated[Metric, Figure("Least on {name}", "the design’s: {least_design:4}", key="body_least")]
    least_design: NotNegative
    groups: Count
    apart: Annotated[
        NotNegative,
        Figure(
            "Patches apart", "mean square, in standard errors, of {groups} groups of patches; noise alone: 1", digits=3
        ),
        Criterion(
            "<=",
            lambda proof, body: 1.0 + ERRORS * (2.0 / max(body.groups, 1)) ** 0.5,
            "light on the patches of a body, against the design",
            OTHER_LIGHT,
            name="body_patches",
            unit="",
        ),
    ]
    in_dark: Annotated[
        Share,
        Criterion(
            "<=",
            FLUX_SHARE,
            "light on patches of a body that are dark by the design",
            OTHER_LIGHT,
            name="body_in_dark",
            unit="of the flux",
        ),
    ]

    @property
    @figure(
        Criterion(
            "<=",
            lambda proof, body: FLUX_SHARE * body.mean_design + ERRORS * (body.mean.standard_error or 0.0),
            "mean light on a body, against the design",
            OTHER_LIGHT,
            name="body_mean_apart",
            unit="W/m²",
        )
    )
    def mean_apart(self) -> float:
        """Distance of the mean from the design's."""
        return abs(self.mean.value - self.mean_design)


_LANDING = ("deviation_rms", "flux_deviation", "fate_disagreement_flux")
# Misses of one mesh with coarse facets; the latter also have causes that are not facets, and need one of the former.
_OF_FACETS = {*_LANDING, "nmse_same_rays", *(f"mitsuba_{name}" for name in (*_LANDING, "nmse_vs_design"))}
_BEHIND_FACETS = {"nmse_vs_design", "own_rays_efficiency", "own_rays_nmse", "lamps_nmse_vs_sum", "plate_nmse_vs_sum"}


@public
class Proof(ResultByLed):
    """Rays through the exported part, against the same rays through the design, on every receiver.

    Figures that are not of the rays or the mesh are those of the first receiver.

    ``receivers``: the rays on each receiver, in the order of the spec. ``triangles``: of the mesh. ``open_edges``: of
    the mesh; 0 for a closed one. ``volume_mm3``: of the mesh. ``sizes``: of each file, beside the size as exported;
    None if that was not given. ``emission_apart``: largest difference of a moment of the design's rays, as they
    leave the source, from that of rays which verification has drawn, in standard errors; None if it has drawn none.
    ``facet_height_um``: of the mesh's vertices over the design. ``far_facets``: optical facets of the mesh far from
    every face of the design, of a body of more than two. ``altered_files``: those whose content was not what
    export.json describes when the rays were cast. ``plain_cast``: first hits by trimesh's own cast against these.
    ``together``: all lamps through their plate. ``on_bodies``: the light of one lamp on each measured body. ``forms``:
    form of every file of the part, told once, with the first LED. ``on_plate``: all lamps stand on one plate, which the
    names of its criteria tell.
    """

    stage: ClassVar[str] = "verify"
    made_from: ClassVar[tuple[str, ...]] = ("lens", "export", "evaluate")

    others: "tuple[Proof, ...]" = ()
    receivers: Annotated[tuple[ReceiverProof, ...], Field(min_length=1)]
    rays: Annotated[Count, Figure("Rays through the part", key="part_rays")]
    seconds: NotNegative
    triangles: Count
    open_edges: Annotated[
        Count,
        Criterion("<=", 0.0, "open edges of the mesh (lens.stl)", "export again: the mesh is not closed", unit="edges"),
    ]
    volume_mm3: Number
    sizes: Sizes | None
    emission_apart: Annotated[
        NotNegative | None,
        Criterion(
            "<=",
            lambda proof: None if proof.emission_apart is None else MOST_APART,
            "emission of independent rays of the LED",
            EMITTED_OTHERWISE,
            name="own_rays_emission",
            unit="standard errors",
        ),
    ]
    facet_height_um: Extent
    far_facets: Annotated[
        Count,
        Criterion(
            "<=",
            lambda proof: 0.0 if proof.far_facets else None,
            "facets of the mesh (lens.stl) far from every face",
            ELSEWHERE,
            unit="facets",
        ),
    ] = 0
    altered_files: tuple[Text, ...] = ()
    plain_cast: Annotated[
        PlainCast,
        Criterion(
            "<=",
            0.0,
            "first hits that a second ray caster finds elsewhere",
            "do not trust this verification, its casting is broken: please report it",
            name="plain_cast_disagreements",
            of="disagreements",
            unit="casts",
        ),
    ]
    together: tuple[LampsTogether, ...] = ()
    on_bodies: tuple[BodyLightProof, ...] = ()
    forms: tuple[FileForm, ...] = ()
    on_plate: Annotated[Flag, Field(exclude=True)] = False
    criteria: Criteria = ()

    @model_validator(mode="before")
    @classmethod
    def _criteria_tell_whether_on_a_plate(cls, content: Any) -> Any:
        stated = content.get("criteria") if isinstance(content, Mapping) else None
        names = [str(criterion.get("name")) for criterion in stated or () if isinstance(criterion, Mapping)]
        return {**content, "on_plate": True} if any(name.endswith("plate_nmse_vs_sum") for name in names) else content

    def judge(self) -> Iterator[Fact]:
        """Judge casts, sizes and form of the files; criteria of further receivers begin with the receiver's name."""
        yield from criteria_in(self)
        yield from size_criteria(self.sizes)
        for form in self.forms:
            yield from (under(form.name, criterion) for criterion in criteria_in(self, form))
        for case in Case(self).among("receivers"):
            yield from map(case.named, _receiver_criteria(self, case.record))
        for lamps in self.together:
            yield from (under(lamps.name, criterion) for criterion in criteria_in(self, lamps))
        for body in self.on_bodies:
            yield from (under(body.name, criterion) for criterion in criteria_in(self, body))

    def deciding_criteria(self) -> Iterator[Fact]:
        """The criteria by which files pass or fail: all but ``facet_misses``."""
        facets = self.facet_misses
        yield from (criterion for criterion in self.all_criteria() if criterion not in facets)

    @property
    def facet_misses(self) -> tuple[Fact, ...]:
        """Criteria that the facets of a mesh miss beside a STEP file that lands all light: they fail no part.

        Empty if anything else fails, and if the form of the files or the light of the STEP file is not known.
        """
        missed = tuple(criterion for criterion in self.all_criteria() if criterion.state == "fail")
        names = {criterion.key.rpartition(": ")[2] for criterion in missed}
        by_step = all(case.record.brep is not None for case in self.cases("receivers"))
        of_facets = bool(names & _OF_FACETS) and names <= _OF_FACETS | _BEHIND_FACETS
        return missed if of_facets and by_step and self.forms else ()

    @property
    @figure(
        Figure(
            "Mesh",
            notice="lens.step is right and decides; "
            "`lensforge export` without --rings makes a mesh as fine as the light asks, with a larger one finer still",
        )
    )
    def print_mesh(self) -> str | None:
        """Sentence on the criteria that the facets of the mesh miss; None if there are none, or if they decide."""
        return "too coarse for the light" if self.facet_misses else None

    @property
    def has_fine_facets(self) -> bool:
        """True if the facets do not cause the differences."""
        return self.facet_height_um.rms <= FINE_FACETS_UM

    def has_form(self, name: str) -> bool:
        """True if the form of the file ``name`` is known, and agrees with the design."""
        return any(form.name == name and form.is_right for form in self.forms)

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
        """A sentence for each file that differs from the export: it was judged all the same."""
        by = {True: "geometry and light", False: "geometry"}
        lit = {"lens.step", "lens.stl"}  # rays go through them
        sentence = "{} is not the file that was exported: judged by its {}"
        return tuple(sentence.format(name, by[name in lit]) for name in self.altered_files)

    def __str__(self) -> str:
        failed = [str(criterion) for criterion in self.all_criteria() if not criterion.holds]
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


def _receiver_criteria(proof: "Proof", receiver: "ReceiverProof") -> Iterator[Fact]:
    """Criteria of the casts on one receiver; the reach of its light follows from the limit of the deviation."""
    reach_mm = receiver.reach_mm
    mismatch = size_mismatch(proof.sizes, "lens.step")
    yield from cast_criteria("", _mesh_evidence(proof, receiver))
    yield from criteria_in(proof, receiver)
    if receiver.brep is not None:
        yield from brep_criteria(receiver.brep, reach_mm, mismatch, proof.has_form("lens.step"))
    if receiver.mitsuba is not None:
        yield from mitsuba_criteria(receiver.mitsuba, reach_mm, _mesh_mismatch(proof), fine=proof.has_fine_facets)


def _mesh_evidence(proof: "Proof", receiver: "ReceiverProof") -> Evidence:
    """Figures of the rays through the mesh, beside those through the STEP file and the size of the body."""
    step_alike = None if receiver.brep is None else brep_evidence(receiver.brep, receiver.reach_mm).lands_alike
    mesh_mismatch = _mesh_mismatch(proof)
    fine = proof.has_fine_facets
    form = form_of_mesh(proof.open_edges, step_alike, mesh_mismatch, fine=fine and not step_alike)
    fault = mesh_mismatch if proof.open_edges == 0 else ""
    limit_mm = receiver.deviation_limit_mm
    return Evidence(receiver.against_design, limit_mm, FLUX_SHARE, FATE_SHARE, form, fault, fine)


def _mesh_mismatch(proof: "Proof") -> str:
    """Difference between the body of the mesh and the export, as a sentence; "" if they agree."""
    return INWARDS if proof.volume_mm3 < 0.0 else size_mismatch(proof.sizes, "lens.stl")


def _noise_or_mesh(proof: "Proof", receiver: "ReceiverProof") -> str:
    """Remedy of a pattern unlike the design's: more rays, if the same rays make the same pattern."""
    if receiver.nmse_same_rays <= receiver.same_rays_limit:
        return "evaluate the design with more rays and the same filter, or verify with more rays"
    return _mesh_evidence(proof, receiver).of_pixels()


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
    housing: Share = 0.0
    second_wall: Share = 0.0
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
    the emitted flux. ``peak_of_mean``: largest stray light over the mean of the sequential light; None if that is 0.
    """

    flux: Annotated[
        StrayFlux,
        Figure(
            "Stray light in window",
            lambda stray, receiver: f"share of the LED’s flux, by reflections; the base is {stray.base}",
            key="detected_stray",
            of="detected_stray",
            unit="%",
        ),
        Figure("Absorbed", key="stray_absorbed", of="absorbed", unit="%", digits=3),
    ]
    efficiency: Annotated[Share, Figure("With reflections", "{gain_words}", key="stray_efficiency", unit="%")]
    efficiency_sequential: Share
    misplaced_flux: Annotated[NotNegative, Figure("Misplaced flux", "{misplaced_words}", key="misplaced", unit="%")]
    nmse_vs_sequential: NotNegative | None
    peak_of_mean: Annotated[
        NotNegative | None,
        Figure(
            "Peak of the stray light",
            "relative to the mean light on the receiver",
            key="stray_peak",
            unit="%",
            digits=3,
        ),
    ]
    balance_error: NotNegative
    detected_stray_by_cause: StrayByCause
    sequential: Irradiance
    direct: Irradiance
    stray: Irradiance

    @property
    def gain_words(self) -> str:
        """Display text of the efficiency without reflections, and of the difference."""
        gain = number(100.0 * (self.efficiency - self.efficiency_sequential), 2)
        return f"efficiency; without reflections {percent(self.efficiency_sequential, 4)}, {gain} points less"

    @property
    def misplaced_words(self) -> str:
        """Display text of the NMSE by the misplaced flux; empty if unknown."""
        nmse = self.nmse_vs_sequential
        return "" if nmse is None else f"an NMSE of {number(nmse, 2)}"


BALANCE = 1e-9  # shares of flux add up to 1: nothing is drawn at random
LEAK_SHARE = 1e-3  # light that passes through the mesh at an edge
DIM_SHARE = 1e-2  # rays below the flux cut-off: the most that they could still change


@public
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
    rays: Annotated[Count, Figure("Rays followed", "absorption {absorption_per_mm}", key="stray_rays")]
    base: Literal["polished", "black"]
    lenses: Count = 1
    neighbours: Annotated[
        Share,
        Figure(
            "Enters another lens",
            lambda stray: f"share of one lamp's light that meets another of the {stray.lenses} lenses",
            unit="%",
            when=lambda stray: stray.lenses > 1,
        ),
    ] = 0.0
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
        """Share of the flux that was too dim to follow to its end."""
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
        by_name = {receiver.name: receiver for receiver in self.receivers}
        if receiver is not None:
            require_choice("receiver", receiver, by_name)
        shown = self.first if receiver is None else by_name[receiver]
        return plot_map(getattr(shown, which), shown.chart, light_unit(None, far_field=shown.far_field), axes)
