"""Limits on the light of a receiver, as readings of its picture: which places count, by which unit, and the bound."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import ceil

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from lensforge.errors import InputError
from lensforge.optics.arrays import Array
from lensforge.optics.efficacy import Efficacy
from lensforge.results import Sense
from lensforge.scene.application_light import light_in
from lensforge.scene.body import Chain
from lensforge.scene.body_view import LitBody
from lensforge.scene.eye_view import EyeView
from lensforge.scene.intensity_limit import LumensBound
from lensforge.scene.light_ends import loss_names
from lensforge.scene.limit_views import LimitView, limit_views
from lensforge.scene.pixel_grid import bilinear
from lensforge.scene.receiver import PosedReceiver, equal_area
from lensforge.scene.region import Region, ZoneOfLimit
from lensforge.spec import Spec
from lensforge.spec.application import names_of
from lensforge.spec.light_limits import (
    BodyLimit,
    LimitSection,
    LossLimit,
    LuminanceLimit,
    ZoneLimit,
)
from lensforge.spec.quantities import FluxShare, LostShare, MeanLuminance, Quantity, SpotLuminance
from lensforge.spec.trades import figures_of

_STEPS_PER_PIXEL = 2  # places along a line or a cut: the light between them is bilinear
_PHOTOMETRIC = ("lx", "cd", "cd/m²")
_OF_PHOTONS = "µmol/(m² s)"
_OF_DOSE = "mJ/cm²"
_MW_PER_CM2 = 0.1  # of 1 W/m²
_PER_WATT = {"mW/cm²": _MW_PER_CM2}
FILTER_PIXELS = 4.0  # diameter of a disc with the variance of the picture's filter, one square pixel along each axis
_FEWEST_RINGS = 2  # of places over a light meter
_MOST_RINGS = 8
_AROUND = 8  # places on a ring
_SENSES: tuple[Sense, Sense] = (">=", "<=")


@dataclass(frozen=True, eq=False)
class LightReading:
    """A ``quantity`` of the light of ``receiver``, by its index, in ``unit``; ``sense``: the side that is wanted.

    ``readings``: matrix from the flux (W) on each pixel to the light at each place, in ``unit``; relative light and
    angles in W/m² or W/sr. Of a loss they are of the flux (W) by cause, as ``scene.light_ends`` orders them. Of a
    luminance they are spots on the view of an eye, of a mean its sum over the area (mm²) of the outline; views of eyes
    and bodies are numbered behind the receivers; ``coarser`` are these spots by half as many pixels. ``blurred``: share
    of the value by which the blur of a view may change it.
    """

    name: str
    receiver: int
    quantity: Quantity
    sense: Sense
    unit: str
    readings: sparse.csr_array
    coarser: sparse.csr_array | None = field(default=None, kw_only=True)
    blurred: float = field(default=0.0, kw_only=True)

    def whole(self, images: Array) -> Array:
        """Light on all pixels, in ``unit``; the ``images`` as they are where the quantity does not ask for it."""
        return self.light_per_flux * images if self.quantity.of_whole else images

    def of(self, images: Float[np.ndarray, "r *_"]) -> Float[np.ndarray, "r k"]:
        """Readings of pictures of flux (W), or of flux (W) by cause."""
        return (self.readings @ images.reshape(len(images), -1).T).T

    @property
    def light_per_flux(self) -> float:
        """Light on a pixel per W on it: the reading, at any place, of a picture of ones."""
        return float(self.readings.sum(axis=1).max())


@dataclass(frozen=True, eq=False)
class LightLimit(LightReading):
    """A bound on a reading of the light: it is to be ``sense`` ``bound``.

    ``application``: number of that whose class asks for it, ``share`` its weight; ``most`` times ``lamp_lm``: its most.
    ``eyes``: number of those that are judged together. ``region``: of a share of the flux, the zone in which it is
    judged by ray.
    """

    bound: float
    application: int | None = field(default=None, kw_only=True)
    share: float = field(default=1.0, kw_only=True)
    most: LumensBound | None = field(default=None, kw_only=True)
    lamp_lm: float = field(default=0.0, kw_only=True)
    eyes: int = field(default=1, kw_only=True)
    region: Region | None = field(default=None, kw_only=True)

    @property
    def by_intensities(self) -> bool:
        """True where the intensities that files hold judge it, and a picture only in a search: at few places."""
        return self.application is not None


def light_limits(
    spec: Spec,
    receivers: Sequence[PosedReceiver],
    efficacy: Efficacy,
    flux_w: float,
    views: Sequence[LimitView] | None = None,
) -> tuple[LightLimit, ...]:
    """The limits of ``spec`` on pictures of ``receivers``; those with two bounds twice.

    ``efficacy``, ``flux_w``: of the source. ``views``: of eyes and bodies, by default as an evaluation sees
    them; a limit on a body without one is left out.

    Raises :class:`InputError` for lux or candela of a source whose lumens are not known, photons of one whose spectrum
    is not, and zones without a pixel.
    """
    names = [section.name for section in spec.all_receivers]
    judged: list[LightLimit] = []
    seen = list(enumerate(limit_views(spec) if views is None else views, len(names)))
    eyes = ((index, view) for index, view in seen if isinstance(view, EyeView))
    for number, limit in enumerate(spec.limits):
        if isinstance(limit, LuminanceLimit):
            scale = _scale(limit, limit.unit or "", f"limits.{number}", efficacy)
            judged += [
                judged_limit for _ in limit.labels(number) for judged_limit in _of_view(limit, scale, *next(eyes))
            ]
            continue
        if isinstance(limit, BodyLimit):
            for index, view in seen:
                if isinstance(view, LitBody) and view.shows(number, limit):
                    judged += _of_body(limit, f"limits.{number}", index, view, efficacy)
            continue
        index = 0 if limit.receiver is None else names.index(limit.receiver)
        where = f"limits.{number}"
        if isinstance(limit, LossLimit):
            judged.append(_of_loss(limit, limit.name or where, index, spec, flux_w))
            continue
        judged += _bounds_of(limit, where, index, receivers[index], efficacy, flux_w)
    for number in range(len(spec.applications)):
        judged += _of_application(number, spec, receivers, efficacy, flux_w)
    return tuple(judged)


def stated_readings(spec: Spec, receivers: Sequence[PosedReceiver], efficacy: Efficacy) -> tuple[LightReading, ...]:
    """Figures by which the application of ``spec`` is judged, without bounds: they are stated."""
    readings = []
    for figure in figures_of(spec.trade, spec.all_receivers[0], efficacy, spec.limits):
        at, matrix = _read(figure.section, receivers[0], figure.label)
        read = _scale(figure.section, figure.bounded, figure.label, efficacy) / receivers[0].pixel_measure * matrix
        quantity = figure.section.quantity(figure.bounded, at)
        unit = figure.section.unit_of(figure.bounded)
        readings.append(LightReading(figure.label, 0, quantity, figure.sense, unit, sparse.csr_array(read)))
    return tuple(readings)


def zones_on(receiver: int, limits: Sequence[LightLimit]) -> tuple[Region, ...]:
    """Zones of those ``limits`` that bound shares of the flux on the ``receiver`` of this number, in their order."""
    return tuple(limit.region for limit in limits if limit.region is not None and limit.receiver == receiver)


def _of_application(
    number: int, spec: Spec, receivers: Sequence[PosedReceiver], efficacy: Efficacy, flux_w: float
) -> Iterator[LightLimit]:
    """Limits by the class of an application, on the first far field: its pixels are intensities of a lamp."""
    index = next(index for index, receiver in enumerate(receivers) if receiver.is_far)
    receiver = receivers[index]
    entry = spec.applications[number]
    name = names_of(spec.applications)[number]
    if entry.lamp_lm is None and efficacy.lumens is None:
        raise InputError(f"{name}: lamp_lm is missing, and the source's lumens are not known; give either")
    source_lm = flux_w * (efficacy.lumens or 0.0) * spec.photometry.lenses
    # The picture is that of one of the [lamps] in the measure of all: their lumens are shared out.
    lamp_lm = source_lm if entry.lamp_lm is None else entry.lamp_lm / len(receiver.lamps)
    scale = lamp_lm / flux_w / receiver.pixel_measure
    for wanted in light_in(entry).limits():
        units = wanted.light.directions(spec.photometry.street_side_deg)
        pixels = bilinear(receiver.grid, *equal_area(receiver.pose.to_local_directions(units)).T)
        readings = sparse.csr_array(scale * (wanted.light.weights * (units[:, 2] >= 0.0)) @ pixels)
        label = f"{name}: {wanted.name}"
        limit = LightLimit(label, index, wanted.quantity, wanted.sense, wanted.unit, readings, wanted.bound)
        all_lm = lamp_lm * len(receiver.lamps)
        yield replace(limit, application=number, share=entry.share, most=wanted.most, lamp_lm=all_lm)


def _of_loss(limit: LossLimit, name: str, index: int, spec: Spec, flux_w: float) -> LightLimit:
    causes = loss_names(Chain.of_lens(spec.lens))
    readings = sparse.csr_array(([1.0 / flux_w], ([0], [causes.index(limit.cause)])), shape=(1, len(causes)))
    return LightLimit(name, index, LostShare(), "<=", "", readings, limit.at_most_share)


def _of_view(limit: LuminanceLimit, scale: float, index: int, view: EyeView) -> Iterator[LightLimit]:
    quantity = MeanLuminance() if view.of_mean else SpotLuminance()
    readings = scale / view.pixel_measure * view.spots()
    if view.of_mean:
        readings = sparse.csr_array(np.full((1, readings.shape[1]), 1e6 * scale))
    for sense, bound in zip(_SENSES, (limit.at_least, limit.at_most), strict=True):
        if bound is not None:
            judged = LightLimit(view.label, index, quantity, sense, limit.unit_of(limit.unit or ""), readings, bound)
            yield judged if view.of_mean else _with_doubt(judged, view, scale)


def _of_body(limit: BodyLimit, where: str, index: int, view: LitBody, efficacy: Efficacy) -> Iterator[LightLimit]:
    (bounded,) = limit.quantities()
    readings = sparse.csr_array(_scale(limit, bounded, where, efficacy) * view.readings(limit))
    quantity = limit.quantity(bounded, np.zeros((0, 2)))
    for sense, bound in zip(_SENSES, limit.bounds(bounded), strict=True):
        if bound is not None:
            yield LightLimit(limit.name or where, index, quantity, sense, limit.unit_of(bounded), readings, bound)


def _with_doubt(limit: LightLimit, view: EyeView, scale: float) -> LightLimit:
    """The ``limit`` on the brightest spot, with what tells how far pixels and blur of the ``view`` may change it."""
    even = not any(count % 2 for count in view.members[0].grid.shape)
    coarser = scale / view.pixel_measure * view.coarser_spots() if even else None
    return replace(limit, coarser=coarser, blurred=view.blur_rad**2, eyes=len(view.members))


def _bounds_of(
    limit: LimitSection, where: str, index: int, receiver: PosedReceiver, efficacy: Efficacy, flux_w: float
) -> Iterator[LightLimit]:
    at, matrix = _read(limit, receiver, where)
    readings = matrix / receiver.pixel_measure
    name = limit.name or where
    for bounded in limit.quantities():
        scale = _scale(limit, bounded, where, efficacy)
        quantity = limit.quantity(bounded, at)
        bound_readings = readings
        region = None
        if isinstance(quantity, FluxShare) and isinstance(limit, ZoneLimit):
            region = ZoneOfLimit(limit, receiver)
            bound_readings = sparse.csr_array(readings.sum(axis=0)[None, :] * (receiver.pixel_measure / flux_w))
        for sense, bound in zip(_SENSES, limit.bounds(bounded), strict=True):
            if bound is not None:
                read = sparse.csr_array(scale * bound_readings)
                unit = limit.unit_of(bounded)
                yield LightLimit(name, index, quantity, sense, unit, read, bound, region=region)


@dataclass(frozen=True)
class _Picture:
    """The picture of a receiver, as limits ask where to read it."""

    receiver: PosedReceiver

    @property
    def half(self) -> float:
        """Largest distance from the axis within which every place is on the picture."""
        radius = min(self.receiver.window.radius, 0.5 * self.receiver.grid.width, 0.5 * self.receiver.grid.height)
        return self.receiver.target_coordinates(np.array([radius]), np.array([0.0]))[0].item()

    @property
    def steps(self) -> int:
        """Places along a cut through the whole picture, less one."""
        return _STEPS_PER_PIXEL * max(self.receiver.grid.shape)

    def steps_between(self, start: tuple[float, float], end: tuple[float, float]) -> int:
        """Places from ``start`` to ``end``, less one; at least one."""
        (x0, y0), (x1, y1) = (self.receiver.chart_coordinates(*np.array(place)[:, None]) for place in (start, end))
        long = np.hypot((x1 - x0) / self.receiver.grid.pixel[0], (y1 - y0) / self.receiver.grid.pixel[1])
        return max(1, ceil(_STEPS_PER_PIXEL * long.item()))


def _scale(limit: LimitSection, bounded: str, where: str, efficacy: Efficacy) -> float:
    """Light by 1 W, per m² or per sr, in the unit of what ``limit`` bounds."""
    unit = limit.unit_of(bounded)
    if unit == _OF_DOSE and limit.exposure_s is not None:
        return _MW_PER_CM2 * limit.exposure_s
    if unit == _OF_PHOTONS:
        if efficacy.photons is None:
            raise InputError(
                f"{where}: its bound is in {unit}, but the source's spectrum is not known; give source.spectrum, or "
                "bounds in W"
            )
        return efficacy.photons
    if unit not in _PHOTOMETRIC:
        return _PER_WATT.get(unit, 1.0)
    if efficacy.lumens is None:
        raise InputError(
            f"{where}: its bound is in {unit}, but the source's lumens are not known; give source.flux_lm, a "
            "spectrum or luminous_efficacy_lm_per_w, or bounds in W"
        )
    return efficacy.lumens


def _pixels_in(limit: LimitSection, receiver: PosedReceiver, where: str) -> Int[np.ndarray, " k"]:
    """Numbers of the pixels of the window whose centres ``limit`` contains."""
    grid = receiver.grid
    x, y = receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
    pixels = np.flatnonzero(receiver.window.pixels(grid) & limit.contains(x, y))
    if not len(pixels):
        raise InputError(f"{where}: no pixel of the receiver lies in it; make it larger, or evaluate.pixels")
    return pixels


def _read(
    limit: LimitSection, receiver: PosedReceiver, where: str
) -> tuple[Float[np.ndarray, "k 2"], sparse.csr_array]:
    """Places (x, y) that ``limit`` reads, and the matrix from pixels to the readings of a light meter there."""
    at = limit.read_at(_Picture(receiver))
    wide = limit.length("meter")
    if at is None:
        grid = receiver.grid
        pixels = _pixels_in(limit, receiver, where)
        x, y = receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
        at = np.stack([x.flat[pixels], y.flat[pixels]], axis=1)
        if wide is None:
            rows = np.arange(len(pixels))
            return at, sparse.csr_array((np.ones(len(pixels)), (rows, pixels)), shape=(len(pixels), x.size))
    offsets = np.zeros((1, 2)) if wide is None else _over_meter(wide, receiver)
    parts = [bilinear(receiver.grid, *receiver.chart_coordinates(*(at + offset).T)) for offset in offsets]
    return at, sparse.csr_array(sum(parts[1:], parts[0]) / len(parts))


def _over_meter(wide: float, receiver: PosedReceiver) -> Float[np.ndarray, "n 2"]:
    """Places over a light meter of this diameter, about its middle.

    The filter of the picture is a part of the meter: what it lacks to the variance of the meter's disc, a sixteenth of
    the square of its diameter, is left to these places.
    """
    pixel = float(receiver.target_coordinates(np.array([receiver.grid.pixel[0]]), np.array([0.0]))[0].item())
    rest = wide**2 - (FILTER_PIXELS * pixel) ** 2
    if rest <= 0.0:
        return np.zeros((1, 2))
    rings = int(np.clip(ceil(np.sqrt(rest) / pixel), _FEWEST_RINGS, _MOST_RINGS))
    radii = 0.5 * np.sqrt(rest * (np.arange(rings) + 0.5) / rings)
    turns = 2.0 * np.pi * (np.arange(_AROUND) + 0.5 * (np.arange(rings) % 2)[:, None]) / _AROUND
    return (radii[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)).reshape(-1, 2)
