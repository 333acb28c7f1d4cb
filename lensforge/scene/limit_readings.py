"""Limits on the light of a receiver, as readings of its picture: which places count, by which unit, and the bound."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from jaxtyping import Float
from scipy import sparse

from lensforge.errors import InputError
from lensforge.optics.arrays import Array
from lensforge.results import Sense
from lensforge.scene.application_light import light_in
from lensforge.scene.body import Chain
from lensforge.scene.eye_view import EyeView, eye_views
from lensforge.scene.intensity_limit import LumensBound
from lensforge.scene.light_ends import loss_names
from lensforge.scene.receiver import PosedReceiver, equal_area
from lensforge.scene.region import Region, ZoneOfLimit
from lensforge.spec import Spec
from lensforge.spec.application import names_of
from lensforge.spec.light_limits import SYMBOLS, LimitSection, LossLimit, LuminanceLimit, ZoneLimit
from lensforge.spec.quantities import FluxShare, LostShare, MeanLuminance, Quantity, SpotLuminance

_PHOTOMETRIC = ("lx", "cd", "cd_per_m2")
_STEPS_PER_PIXEL = 2  # places along a line or a cut: the light between them is bilinear
_SENSES: tuple[Sense, Sense] = (">=", "<=")


@dataclass(frozen=True, eq=False)
class LightLimit:
    """One bound on the light of ``receiver``, by its index: the ``quantity`` is ``sense`` ``bound``, in ``unit``.

    ``readings``: matrix from the flux (W) on each pixel to the light at each place, in ``unit``; relative light and
    angles in W/m² or W/sr. Of a loss they are of the flux (W) by cause, as ``scene.light_ends`` orders them. Of a
    luminance they are spots on the view of an eye, of a mean its sum over the area (mm²) of the outline; views are
    numbered behind the receivers; ``coarser`` are these spots by half as many pixels. ``application``: number of that
    whose class asks for it, ``share`` its weight; ``most`` times ``lamp_lm``: its most. ``blurred``: share of the value
    by which the blur of a view may change it. ``eyes``: number of those that are judged together. ``region``: of a
    share of the flux, the zone in which it is judged by ray.
    """

    name: str
    receiver: int
    quantity: Quantity
    sense: Sense
    bound: float
    unit: str
    readings: sparse.csr_array
    application: int | None = None
    share: float = 1.0
    most: LumensBound | None = None
    lamp_lm: float = 0.0
    coarser: sparse.csr_array | None = None
    blurred: float = 0.0
    eyes: int = 1
    region: Region | None = None

    @property
    def by_intensities(self) -> bool:
        """True where the intensities that files hold judge it, and a picture only in a search: at few places."""
        return self.application is not None

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


def light_limits(
    spec: Spec,
    receivers: Sequence[PosedReceiver],
    lumens_per_watt: float | None,
    flux_w: float,
    views: Sequence[EyeView] | None = None,
) -> tuple[LightLimit, ...]:
    """The limits of ``spec`` on pictures of ``receivers``; those with two bounds twice. ``flux_w``: of the source.

    ``views``: of the eyes, by default as an evaluation sees them.

    Raises :class:`InputError` for lux or candela of a source whose lumens are not known, and zones without a pixel.
    """
    names = [section.name for section in spec.all_receivers]
    judged: list[LightLimit] = []
    seen = enumerate(eye_views(spec) if views is None else views, len(names))
    for number, limit in enumerate(spec.limits):
        if isinstance(limit, LuminanceLimit):
            scale = _scale(limit.unit or "", f"limits.{number}", lumens_per_watt)
            judged += [
                judged_limit for _ in limit.labels(number) for judged_limit in _of_view(limit, scale, *next(seen))
            ]
            continue
        index = 0 if limit.receiver is None else names.index(limit.receiver)
        where = f"limits.{number}"
        if isinstance(limit, LossLimit):
            judged.append(_of_loss(limit, limit.name or where, index, spec, flux_w))
            continue
        judged += _bounds_of(limit, where, index, receivers[index], lumens_per_watt, flux_w)
    for number in range(len(spec.applications)):
        judged += _of_application(number, spec, receivers, lumens_per_watt, flux_w)
    return tuple(judged)


def zones_on(receiver: int, limits: Sequence[LightLimit]) -> tuple[Region, ...]:
    """Zones of those ``limits`` that bound shares of the flux on the ``receiver`` of this number, in their order."""
    return tuple(limit.region for limit in limits if limit.region is not None and limit.receiver == receiver)


def _of_application(
    number: int, spec: Spec, receivers: Sequence[PosedReceiver], lumens_per_watt: float | None, flux_w: float
) -> Iterator[LightLimit]:
    """Limits by the class of an application, on the first far field: its pixels are intensities of a lamp."""
    index = next(index for index, receiver in enumerate(receivers) if receiver.is_far)
    receiver = receivers[index]
    entry = spec.applications[number]
    name = names_of(spec.applications)[number]
    if entry.lamp_lm is None and lumens_per_watt is None:
        raise InputError(f"{name}: lamp_lm is missing, and the source's lumens are not known; give either")
    source_lm = flux_w * (lumens_per_watt or 0.0) * spec.photometry.lenses
    # The picture is that of one of the [lamps] in the measure of all: their lumens are shared out.
    lamp_lm = source_lm if entry.lamp_lm is None else entry.lamp_lm / len(receiver.lamps)
    scale = lamp_lm / flux_w / receiver.pixel_measure
    for wanted in light_in(entry).limits():
        units = wanted.light.directions(spec.photometry.street_side_deg)
        pixels = _bilinear(receiver, *equal_area(receiver.pose.to_local_directions(units)).T)
        readings = sparse.csr_array(scale * (wanted.light.weights * (units[:, 2] >= 0.0)) @ pixels)
        label = f"{name}: {wanted.name}"
        limit = LightLimit(label, index, wanted.quantity, wanted.sense, wanted.bound, wanted.unit, readings)
        all_lm = lamp_lm * len(receiver.lamps)
        yield replace(limit, application=number, share=entry.share, most=wanted.most, lamp_lm=all_lm)


def _of_loss(limit: LossLimit, name: str, index: int, spec: Spec, flux_w: float) -> LightLimit:
    causes = loss_names(Chain.of_lens(spec.lens))
    readings = sparse.csr_array(([1.0 / flux_w], ([0], [causes.index(limit.cause)])), shape=(1, len(causes)))
    return LightLimit(name, index, LostShare(), "<=", limit.at_most_share, "", readings)


def _of_view(limit: LuminanceLimit, scale: float, index: int, view: EyeView) -> Iterator[LightLimit]:
    quantity = MeanLuminance() if view.of_mean else SpotLuminance()
    readings = scale / view.pixel_measure * view.spots()
    if view.of_mean:
        readings = sparse.csr_array(np.full((1, readings.shape[1]), 1e6 * scale))
    for sense, bound in zip(_SENSES, (limit.at_least, limit.at_most), strict=True):
        if bound is not None:
            judged = LightLimit(view.label, index, quantity, sense, bound, SYMBOLS[limit.unit or ""], readings)
            yield judged if view.of_mean else _with_doubt(judged, view, scale)


def _with_doubt(limit: LightLimit, view: EyeView, scale: float) -> LightLimit:
    """The ``limit`` on the brightest spot, with what tells how far pixels and blur of the ``view`` may change it."""
    even = not any(count % 2 for count in view.members[0].grid.shape)
    coarser = scale / view.pixel_measure * view.coarser_spots() if even else None
    return replace(limit, coarser=coarser, blurred=view.blur_rad**2, eyes=len(view.members))


def _bounds_of(
    limit: LimitSection, where: str, index: int, receiver: PosedReceiver, lumens_per_watt: float | None, flux_w: float
) -> Iterator[LightLimit]:
    at = limit.read_at(_Picture(receiver))
    readings = _readings(limit, at, receiver, where) / receiver.pixel_measure
    name = limit.name or where
    for bounded in limit.quantities():
        scale = _scale(bounded, where, lumens_per_watt)
        quantity = limit.quantity(bounded, at)
        bound_readings = readings
        region = None
        if isinstance(quantity, FluxShare) and isinstance(limit, ZoneLimit):
            region = ZoneOfLimit(limit, receiver)
            bound_readings = sparse.csr_array(readings.sum(axis=0)[None, :] * (receiver.pixel_measure / flux_w))
        for sense, bound in zip(_SENSES, limit.bounds(bounded), strict=True):
            if bound is not None:
                read = sparse.csr_array(scale * bound_readings)
                yield LightLimit(name, index, quantity, sense, bound, limit.unit_of(bounded), read, region=region)


@dataclass(frozen=True)
class _Picture:
    """The picture of a receiver, as limits ask where to read it."""

    receiver: PosedReceiver

    @property
    def half(self) -> float:
        """Largest distance of a place from the axis along x."""
        return self.receiver.target_coordinates(np.array([self.receiver.window.radius]), np.array([0.0]))[0].item()

    @property
    def steps(self) -> int:
        """Places along a cut through the whole picture, less one."""
        return _STEPS_PER_PIXEL * max(self.receiver.grid.shape)

    def steps_between(self, start: tuple[float, float], end: tuple[float, float]) -> int:
        """Places from ``start`` to ``end``, less one; at least one."""
        (x0, y0), (x1, y1) = (self.receiver.chart_coordinates(*np.array(place)[:, None]) for place in (start, end))
        long = np.hypot((x1 - x0) / self.receiver.grid.pixel[0], (y1 - y0) / self.receiver.grid.pixel[1])
        return max(1, ceil(_STEPS_PER_PIXEL * long.item()))


def _scale(quantity: str, where: str, lumens_per_watt: float | None) -> float:
    if quantity not in _PHOTOMETRIC:
        return 1.0
    if lumens_per_watt is None:
        raise InputError(
            f"{where}: its bound is in {quantity}, but the source's lumens are not known; give source.flux_lm, a "
            "spectrum or luminous_efficacy_lm_per_w, or bounds in W"
        )
    return lumens_per_watt


def _readings(
    limit: LimitSection, at: Float[np.ndarray, "k 2"] | None, receiver: PosedReceiver, where: str
) -> sparse.csr_array:
    if at is not None:
        return _bilinear(receiver, *receiver.chart_coordinates(*at.T))
    grid = receiver.grid
    inside = receiver.window.pixels(grid) & limit.contains(
        *receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
    )
    if not inside.any():
        raise InputError(f"{where}: no pixel of the receiver lies in it; make it larger, or evaluate.pixels")
    pixels = np.flatnonzero(inside)
    ones = np.ones(len(pixels))
    shape = (len(pixels), inside.size)
    return sparse.csr_array((ones, (np.arange(len(pixels)), pixels)), shape=shape)


def _bilinear(receiver: PosedReceiver, x: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"]) -> sparse.csr_array:
    """Matrix from pixels to places on the chart, bilinear between their centres, as at the edge beyond the last."""
    grid = receiver.grid
    column = np.maximum((x / grid.width + 0.5) * grid.columns - 0.5, 0.0)
    row = np.maximum((y / grid.height + 0.5) * grid.rows - 0.5, 0.0)
    left = column.astype(int)
    below = row.astype(int)
    right = column - left
    up = row - below
    entries = []
    rows = []
    pixels = []
    for more_x, share_x in ((0, 1.0 - right), (1, right)):
        for more_y, share_y in ((0, 1.0 - up), (1, up)):
            entries.append(share_x * share_y)
            rows.append(np.arange(len(column)))
            pixels.append(
                np.minimum(below + more_y, grid.rows - 1) * grid.columns + np.minimum(left + more_x, grid.columns - 1)
            )
    together = np.concatenate(entries), (np.concatenate(rows), np.concatenate(pixels))
    return sparse.csr_array(together, shape=(len(column), grid.rows * grid.columns))
