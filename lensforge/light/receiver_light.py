"""The light on one receiver: its metrics with their standard errors, the flux by fate, its maps and its regions.

A spec that sets no limits is judged by two bounds. ``benchmarks/verdicts.py`` calibrates both: the
worst of the shipped specs has an NMSE of 0.08 as a draft, and puts 0.8 of what two faces transmit into its target;
useless lenses (a 6 mm source in an 8 mm lens, a word finer than the image of its source, a lens of hardly more than
cavity and wall, a target beyond the étendue of its source) have an NMSE from 0.2 to 0.75, and put 0.07 to 0.66 of it
there.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, Field, model_validator

from lensforge.light.beam_colour import BeamColour
from lensforge.light.region_light import RegionLight
from lensforge.optics.fundamental_limits import BY_SYMMETRY, LEVELS, transmittance_of
from lensforge.public import public
from lensforge.results import Irradiance, Metric, NotNegative, Number, Point, Positive, Record, Share, Text
from lensforge.results.chart import Chart
from lensforge.results.estimates import (
    nmse,
)
from lensforge.results.figure import Apart, Figure, figures_at
from lensforge.results.numerals import number, percent, square
from lensforge.results.record import Array
from lensforge.spec import Spec
from lensforge.spec.polished_faces import scatters_about_the_light
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.target_sections import IN_TARGET

if TYPE_CHECKING:
    from lensforge.scene.lens import Lens

_FLUX_ADDS_UP = 1e-9
_OF_NOISE = 0.1  # by which the noise that is taken off an NMSE may differ from that in the mean map
Picture = Literal["map", "raw_map", "target_map"]


class Flux(Record):
    """The flux budget: shares of the emitted flux by fate; they add up to 1.

    ``detected``: in the window. ``outside``: on the receiver's surface outside the window. ``missed``: never reached
    that surface. ``absorbed``: by the body from face to face, and by mirrors. ``cover_glass``: reflected and absorbed
    by it. ``bodies``: likewise by the further bodies, and light that ends there. ``housing``: taken by the
    bodies of the scene that it meets; ``second_wall``: went on from these by all its events, and met a further one.
    ``reflected``: at faces that let light through, which a sequential design does not follow.
    """

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    not_converged: Share
    absorbed: Share = 0.0
    cover_glass: Share = 0.0
    bodies: Share = 0.0
    housing: Share = 0.0
    second_wall: Share = 0.0
    reflected: Share


class MissedByCause(Record):
    """Flux that missed the receiver's surface, by cause, as shares of the emitted flux."""

    backward: Share
    outside_cavity: Share
    base: Share
    missed_receiver: Share
    surfaces_intersect: Share
    event_limit: Share = 0.0
    flange: Share = 0.0


class BlockedLight(Record):
    """Light that a body of the scene keeps from the receiver.

    ``share``: of the emitted flux that the body takes; ``returned``: that which it reflects into the window, None of a
    black one; ``passed``: that which comes through a clear one into the window; both of the body from which light comes
    last. ``trapped``: of ``share``, what ends within a clear one. ``place_mm``: mean of the places at which light meets
    it, weighted by flux.
    """

    name: Text
    share: Annotated[Metric, Figure("Blocked by housing", "{place_words}", key="blocked", unit="%")]
    returned: Annotated[
        Metric | None,
        Figure("Light by reflection", "in the window, by {name}; the search counts one reflection", unit="%"),
    ] = None
    passed: Annotated[
        Metric | None,
        Figure("Light through a clear body", "in the window, through {name}; the search takes it for air", unit="%"),
    ] = None
    trapped: Annotated[
        Metric | None, Figure("Trapped in a clear body", "reflected totally within {name}", unit="%")
    ] = None
    place_mm: Point

    @property
    def place_words(self) -> str:
        """Words for the body and the place."""
        return f"by {self.name}, about ({', '.join(f'{number(value, 3)}' for value in self.place_mm)}) mm"


class RawMetrics(Record):
    """Metrics of the picture as it was binned and filtered: with ray noise, which raises NMSE and RSD, and darkens the
    darkest pixel. ``uniformity`` and ``rsd`` are None if the spec names no mask.
    """

    nmse: NotNegative
    uniformity: NotNegative | None
    rsd: NotNegative | None


class EstimatedLight(Record):
    """Light that a lens may bring to the same pixels, by an étendue estimated from the rays of a source.

    No bound: where places of a source differ in luminance, rays tell too little of the brightest.
    """

    efficiency: Share
    share_in_target: Share
    nmse: NotNegative


@public
class Possible(Record):
    """Bounds that physics sets to light on the same pixels from any lens that keeps the largest radius.

    ``efficiency``, ``share_in_target``: at most. ``nmse``: at least, of the light that arrives. ``law``: the law that
    sets the share. ``estimate``: where the luminance of the source is known by its rays alone, what étendue may leave,
    which the bounds leave out; None if the luminance is known.
    """

    efficiency: Share
    share_in_target: Share
    nmse: NotNegative
    law: Text
    estimate: EstimatedLight | None = None

    @property
    def luminance_estimated(self) -> bool:
        """True where the luminance of the source is an estimate from its rays."""
        return self.estimate is not None

    @property
    def expected_share(self) -> tuple[float, str]:
        """Largest share to be expected in the target, and its law: the estimate if that is lower than the bound."""
        if self.estimate is not None and self.estimate.share_in_target < self.share_in_target:
            return self.estimate.share_in_target, "étendue may leave, by an estimate"
        return self.share_in_target, f"is the upper bound ({self.law})"


class WindowSize(Record):
    """The window of a receiver: a centred rectangle, or in the far field and on a sphere a circle; in its unit."""

    width: Positive | None
    height: Positive | None
    radius: Positive | None


def _known_kind(kind: str) -> str:
    if kind not in ReceiverSection.kinds:
        raise ValueError(f"{kind!r}: must be one of {', '.join(ReceiverSection.kinds)}")
    return kind


_OF_POSSIBLE = 0.9  # of the efficiency: less deserves a look; the shipped specs have 0.78 to 1.00


def _error_note(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """Definition of the NMSE, and its dependence on the pixels."""
    return f"mean square deviation over the target’s mean square{by_pixels(receiver)}{_unjudged(lens.spec)}"


def _share_note(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """Definition of the share in the target, and an estimate of what étendue leaves."""
    where = "share of the LED’s flux where the target is above a tenth of its maximum"
    return f"{where}{_estimate(receiver)}{_unjudged(lens.spec)}"


def _efficiency_note(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """Definition of the efficiency: whose flux, and in which window."""
    whole = lens.spec.all_lamps.whole
    return f"share of the {f'flux {whole}' if whole else 'LED’s flux'} {window_words(receiver)}"


def _efficiency_law(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """Law that bounds the efficiency."""
    if lens.spec.lens.is_opaque:
        return "reflectance of the mirror"
    return "transmittance and largest deflection of two faces"


def _efficiency_notice(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """A notice of an efficiency far below its bound."""
    far = receiver.efficiency.value < _OF_POSSIBLE * receiver.possible.efficiency
    return f"below {_OF_POSSIBLE:g} of the upper bound" if far else ""


def _uniformity_note(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """Definition of the uniformity, and its region."""
    return f"{receiver.evenness_words} in the mask {mask_words(lens.spec, receiver.name)}"


def _rsd_note(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    """Definition of the RSD, and its region."""
    return f"standard deviation/mean in the mask {mask_words(lens.spec, receiver.name)}"


def _brighter_by(receiver: "ReceiverLight", lens: "Lens", other: str) -> str:
    """Changes that would bring more light; if symmetry bounds the lens, another shape of its faces."""
    if receiver.possible.law == BY_SYMMETRY:
        return LEVELS
    scatter = "less scatter, " if scatters_about_the_light(lens.spec) else ""  # which spreads the light of any lens
    return f"{scatter}a larger lens, a smaller source or {other}"


def window_words(receiver: "ReceiverLight") -> str:
    """Phrase after "flux" for the part of the receiver in which it is detected."""
    return f"within {receiver.where}" if receiver.is_far_field else receiver.where


def mask_words(spec: Spec, receiver: str) -> str:
    """Phrase after "mask" for the region of uniform light on the ``receiver`` called so: its size, or their number."""
    targets = next((section.targets for section in spec.all_receivers if section.name == receiver), ())
    sizes = [(pair, target.unit) for target in targets if (pair := target.pair("uniform")) is not None]
    if len(sizes) != 1:
        return f"of {len(sizes)} parts"
    (width, height), unit = sizes[0]
    end = "°" if unit == "deg" else " mm"
    return f"of {width:g}{end}" if width == height else f"of {width:g} × {height:g}{end}"


def _unjudged(spec: Spec) -> str:
    return "; not judged, as the spec has limits" if spec.has_limits else ""


def _estimate(receiver: "ReceiverLight") -> str:
    """Phrase for the share limited by an estimated étendue, if the source's luminance is known from its rays alone."""
    possible = receiver.possible
    estimate = possible.estimate
    if estimate is None or estimate.share_in_target >= possible.share_in_target:
        return ""
    return f"; étendue may leave {percent(estimate.share_in_target)}, an estimate from rays of the source and no bound"


def by_pixels(receiver: "ReceiverLight") -> str:
    """Phrase for the NMSE with half as many pixels, if the change exceeds its noise."""
    change = receiver.nmse_of_raster
    error = receiver.nmse.standard_error
    if change is None or abs(change) <= (error or 0.0):
        return ""
    halved = receiver.nmse.value - change
    shown = number(halved, 2) if halved >= 0.0 else square(halved, error)
    return f"; depends on the pixels: {shown} with pixels twice as wide"


LARGEST_NMSE = 0.10
LEAST_SHARE = 0.7  # of what is possible, and of what two faces transmit at normal incidence, must lie in the target


def possible_share(receiver: "ReceiverLight", transmittance: float) -> tuple[float, str]:
    """Largest share of the flux in the target on ``receiver``, and its law; ``transmittance``: of both faces."""
    whole = transmittance * receiver.wanted_in_target
    possible, law = receiver.possible.expected_share
    if whole <= possible:
        return whole, "two faces transmit into the target" if transmittance < 1.0 else "the target takes"
    return possible, law


def _least_share(light: object, receiver: "ReceiverLight", lens: "Lens") -> float | None:
    """Share of the flux that must lie in the target; None if the spec has limits, by which the light is judged."""
    return None if lens.spec.has_limits else LEAST_SHARE * possible_share(receiver, transmittance_of(lens.media))[0]


def _least_share_note(light: object, receiver: "ReceiverLight", lens: "Lens") -> str:
    most, law = possible_share(receiver, transmittance_of(lens.media))
    return f"{LEAST_SHARE:g} of the {percent(most)} that {law}"


NMSE = Figure("Pattern error (NMSE)", is_square=True)
EFFICIENCY = Figure("Efficiency", unit="%")
UNIFORMITY = Figure("Uniformity")
RSD = Figure("RSD")


class ReceiverLight(Record):
    """The light on one receiver. Texts and limits of its figures are by the light and the lens, too.

    ``width``, ``height``: of its chart, in mm, or for the far field of the equal-area chart, 2 sin(gamma / 2). ``map``,
    ``raw_map``, ``target_map``: irradiance (W/m^2), or intensity (W/sr), [row y, column x] after the filter, before it,
    and of the target, scaled to the flux there. ``nmse``: Eq. (7) with the target scaled to the flux that arrives.
    ``efficiency``: share of the emitted flux in the window; ``share_in_target``: where the target is above a tenth of
    its largest pixel, by ray. ``uniformity``, ``rsd``: min/mean, and standard deviation/mean, in the region of
    ``uniform_mm`` or ``uniform_deg``; None if the spec names none. ``in_region``: mean light and evenness there, or
    where the target is bright, and the peak; None if one of the replicates is dark.

    ``lost_in_bodies``: flux lost in each of the further bodies, by its name, as shares of the emitted flux;
    ``blocked``: by each of the bodies of the scene that blocks some.

    ``nmse``, ``uniformity`` and ``rsd`` are those of the light, without ray noise; ``raw``: those of ``map``, with it.
    Where the replicates are too few to tell light from noise, both are the same, and there is no standard error.
    ``nmse_of_noise``: the NMSE of the noise in ``map``, about as much as it adds to that of ``raw``.
    ``nmse_of_raster``: the NMSE less that on half as many pixels; None if it was not measured.

    ``colour``: of the beam, ``tristimulus_map``: X, Y and Z (lx, or cd), filtered; None without colour, the first also
    in the dark.
    """

    name: Text
    kind: Annotated[Text, AfterValidator(_known_kind)]
    place: Text
    width: Annotated[Positive, Field(le=1e12)]
    height: Annotated[Positive, Field(le=1e12)]
    window: WindowSize
    nmse: Annotated[
        Metric,
        replace(
            NMSE,
            note=_error_note,
            limit=lambda light, receiver, lens: None if lens.spec.has_limits else LARGEST_NMSE,
            possible=lambda light, receiver, lens: receiver.possible.nmse or None,
            possible_note="étendue of each pixel, for the light that arrives",
            remedy=lambda light, receiver, lens: _brighter_by(receiver, lens, "a coarser pattern"),
            when=lambda light, receiver, lens: lens.spec.optimise.aim == "pattern",
        ),
    ]
    share_in_target: Annotated[
        Metric,
        Figure(
            "Light in the target",
            _share_note,
            unit="%",
            sense=">=",
            limit=_least_share,
            limit_note=_least_share_note,
            possible="possible.share_in_target",
            possible_note="{possible.law}",
            remedy=lambda light, receiver, lens: _brighter_by(receiver, lens, "a wider target"),
        ),
    ]
    efficiency: Annotated[
        Metric,
        replace(
            EFFICIENCY,
            note=_efficiency_note,
            sense=">=",
            possible="possible.efficiency",
            possible_note=_efficiency_law,
            notice=_efficiency_notice,
        ),
    ]
    uniformity: Annotated[Metric | None, replace(UNIFORMITY, note=_uniformity_note)]
    rsd: Annotated[Metric | None, replace(RSD, note=_rsd_note)]
    in_region: Annotated[RegionLight | None, Apart()] = None
    raw: RawMetrics
    nmse_of_noise: NotNegative | None
    nmse_of_raster: Number | None = None
    possible: Possible
    flux: Flux
    missed_by_cause: MissedByCause
    lost_in_bodies: dict[str, Share] = Field(default_factory=dict)
    blocked: Annotated[tuple[BlockedLight, ...], Apart()] = ()
    map: Irradiance
    raw_map: Irradiance
    target_map: Irradiance
    colour: Annotated[BeamColour | None, Apart()] = None
    tristimulus_map: Annotated[Float[np.ndarray, "3 h w"], Array(3, "h", "w", least=0.0)] | None = None

    @property
    def wanted_in_target(self) -> float:
        """Share of the target's own light in the region counted as target: dark parts of a picture may have much."""
        wanted = self.target_map
        total = float(wanted.sum())
        return float(wanted[wanted > IN_TARGET * wanted.max()].sum()) / total if total > 0.0 else 1.0

    @property
    def evenness_words(self) -> str:
        """Display text of the uniformity; one-sided if noise would put it above 1."""
        capped = self.uniformity is not None and self.uniformity.standard_error and self.uniformity.value >= 1.0
        return "min/mean" + (", at most 1: the error is to one side" if capped else "")

    @property
    def chart(self) -> Chart:
        """Size of the maps, for figures."""
        return Chart(self.width, self.height, self.is_far_field)

    @property
    def section(self) -> type[ReceiverSection]:
        """The kind of receiver, as a spec has it."""
        return ReceiverSection.kinds[self.kind]

    @property
    def is_far_field(self) -> bool:
        """True for light by direction."""
        return self.section.unit == "deg"

    @property
    def pixels(self) -> int:
        """Number of pixels along the longer side."""
        return int(max(self.map.shape))

    @property
    def where(self) -> str:
        """Phrase for the window."""
        if self.is_far_field:
            return f"{self.place.removeprefix('in the far field, to ')} from the axis"
        return "on it" if self.section.is_round else f"within {self.window.width:g} × {self.window.height:g} mm"

    def follows(self) -> Iterator[tuple[str, float, float]]:
        """Efficiency and missed flux by the budget, and the NMSE by the maps, with their noise and without."""
        yield "efficiency.value", self.efficiency.value, self.flux.detected
        yield "flux.missed", self.flux.missed, sum(self.missed_by_cause.model_dump().values())
        yield "raw.nmse", self.raw.nmse, nmse(self.map, self.target_map)
        if self.nmse_of_noise is not None and self.nmse.standard_error is not None:
            noise = self.nmse_of_noise * float(np.sum(self.map**2) / np.sum(self.target_map**2))
            least, most = (self.raw.nmse - factor * noise for factor in (1.0 + _OF_NOISE, 1.0 - _OF_NOISE))
            yield "nmse.value", self.nmse.value, min(max(self.nmse.value, least), most)

    @model_validator(mode="after")
    def _flux_adds_up(self) -> "ReceiverLight":
        total = sum(self.flux.model_dump().values())
        if abs(total - 1.0) > _FLUX_ADDS_UP:
            raise ValueError(f"flux: its shares add up to {total:.9g}, must be 1")
        return self


METRICS = figures_at(ReceiverLight)  # by the names of metrics
