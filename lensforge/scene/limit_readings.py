"""Limits on the light of a receiver, as readings of its picture: which places count, by which unit, and the bound."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import cast, get_args

import numpy as np
from jaxtyping import Bool, Float
from scipy import sparse

from lensforge.errors import InputError
from lensforge.results import Sense
from lensforge.scene.application_light import light_in
from lensforge.scene.body import Chain
from lensforge.scene.eye_view import EyeView, eye_views
from lensforge.scene.intensity_limit import GlareLaw, LumensBound
from lensforge.scene.light_ends import loss_names
from lensforge.scene.receiver import PosedReceiver, equal_area
from lensforge.scene.region import Region, ZoneOfLimit
from lensforge.spec import Spec
from lensforge.spec.application import names_of
from lensforge.spec.light_limits import (
    BeamAngleLimit,
    GlareLimit,
    LimitSection,
    LineLimit,
    LossLimit,
    LuminanceLimit,
    PointsLimit,
    Quantity,
    ZoneLimit,
)

_UNITS = {"w_per_m2": "W/m²", "lx": "lx", "w_per_sr": "W/sr", "cd": "cd", "deg": "°"}
_UNITS |= {"w_per_m2_sr": "W/(m² sr)", "cd_per_m2": "cd/m²"}
_PHOTOMETRIC = ("lx", "cd", "cd_per_m2")
_STEPS_PER_PIXEL = 2  # places along a line or a cut: the light between them is bilinear
_SENSES: tuple[Sense, Sense] = (">=", "<=")


@dataclass(frozen=True, eq=False)
class LightLimit:
    """One bound on the light of ``receiver``, by its index: the ``quantity`` is ``sense`` ``bound``, in ``unit``.

    ``readings``: matrix from the flux (W) on each pixel to the light at each place, in ``unit``; relative light and
    angles in W/m² or W/sr. ``angles_deg``: of the places of a beam angle, whose half side counts at ``level``. Of
    glare, whose quantity is its law, the last place is the mean luminance (cd/m²), the others are veiling luminance; of
    a ratio the first place is over the second. Of a loss the readings are of the flux (W) by cause, as
    ``scene.light_ends`` orders them. Of a luminance they are spots on the view of an eye, of a mean its sum over the
    area (mm²) of the outline; views are numbered behind the receivers; ``coarser`` are these spots by half as many
    pixels. ``application``: number of that whose class asks for it, ``share`` its weight; ``most`` times ``lamp_lm``:
    its most. ``blurred``: share of the value by which the blur of a view may change it. ``eyes``: number of those that
    are judged together. ``region``: of a share of the flux, the zone in which it is judged by ray.
    """

    name: str
    receiver: int
    quantity: Quantity | GlareLaw
    sense: Sense
    bound: float
    unit: str
    readings: sparse.csr_array
    angles_deg: Float[np.ndarray, " k"] | None = None
    level: float = 1.0
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

    @property
    def of_losses(self) -> bool:
        """True where it reads the flux by cause of its loss, and no picture."""
        return self.quantity == "loss"

    @property
    def of_view(self) -> bool:
        """True where it reads the view of an eye, and no receiver."""
        return self.quantity in ("luminance", "mean_luminance")

    @property
    def is_share(self) -> bool:
        """True where it bounds a share of the flux of the source, whatever that is."""
        return self.quantity in ("share", "loss")

    @property
    def flux_power(self) -> float:
        """Power of the flux of the source by which its value grows; of glare that in the dark."""
        if isinstance(self.quantity, GlareLaw):
            return 1.0 - self.quantity.at(0.0)[1]
        return 1.0 if self.quantity in ("light", "luminance", "mean_luminance") else 0.0

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
    return LightLimit(name, index, "loss", "<=", limit.at_most_share, "", readings)


def _of_view(limit: LuminanceLimit, scale: float, index: int, view: EyeView) -> Iterator[LightLimit]:
    quantity: Quantity = "mean_luminance" if view.of_mean else "luminance"
    readings = scale / view.pixel_measure * view.spots()
    if view.of_mean:
        readings = sparse.csr_array(np.full((1, readings.shape[1]), 1e6 * scale))
    for sense, bound in zip(_SENSES, (limit.at_least, limit.at_most), strict=True):
        if bound is not None:
            judged = LightLimit(view.label, index, quantity, sense, bound, _UNITS[limit.unit or ""], readings)
            yield judged if view.of_mean else _with_doubt(judged, view, scale)


def _with_doubt(limit: LightLimit, view: EyeView, scale: float) -> LightLimit:
    """The ``limit`` on the brightest spot, with what tells how far pixels and blur of the ``view`` may change it."""
    even = not any(count % 2 for count in view.members[0].grid.shape)
    coarser = scale / view.pixel_measure * view.coarser_spots() if even else None
    return replace(limit, coarser=coarser, blurred=view.blur_rad**2, eyes=len(view.members))


def _bounds_of(
    limit: LimitSection, where: str, index: int, receiver: PosedReceiver, lumens_per_watt: float | None, flux_w: float
) -> Iterator[LightLimit]:
    readings = _readings(limit, receiver, where) / receiver.pixel_measure
    name = limit.name or where
    for quantity in limit.quantities():
        scale = _scale(quantity, where, lumens_per_watt)
        kind = _kind(quantity)
        bound_readings = readings
        region = None
        if quantity == "share" and isinstance(limit, ZoneLimit):
            region = ZoneOfLimit(limit, receiver)
            bound_readings = sparse.csr_array(readings.sum(axis=0)[None, :] * (receiver.pixel_measure / flux_w))
        angles = None
        level = 1.0
        if isinstance(limit, BeamAngleLimit):
            angles = _cut(receiver)
            level = limit.level
        for sense, bound in zip(_SENSES, limit.bounds(quantity), strict=True):
            if bound is not None:
                unit = _UNITS.get(quantity, "")
                read = sparse.csr_array(scale * bound_readings)
                yield LightLimit(name, index, kind, sense, bound, unit, read, angles, level, region=region)


def _kind(quantity: str) -> Quantity:
    if quantity == "deg":
        return "beam_angle"
    return cast(Quantity, quantity) if quantity in get_args(Quantity) else "light"


def _scale(quantity: str, where: str, lumens_per_watt: float | None) -> float:
    if quantity not in _PHOTOMETRIC:
        return 1.0
    if lumens_per_watt is None:
        raise InputError(
            f"{where}: its bound is in {quantity}, but the source's lumens are not known; give source.flux_lm, a "
            "spectrum or luminous_efficacy_lm_per_w, or bounds in W"
        )
    return lumens_per_watt


def _readings(limit: LimitSection, receiver: PosedReceiver, where: str) -> sparse.csr_array:
    match limit:
        case PointsLimit():
            x, y = np.array(limit.places).T
            return _bilinear(receiver, *receiver.chart_coordinates(x, y))
        case LineLimit():
            (x0, y0), (x1, y1) = (receiver.chart_coordinates(*np.array(end)[:, None]) for end in limit.places)
            long = np.hypot((x1 - x0) / receiver.grid.pixel[0], (y1 - y0) / receiver.grid.pixel[1])
            part = np.linspace(0.0, 1.0, max(2, ceil(_STEPS_PER_PIXEL * long.item()) + 1))
            (xs, ys), (xe, ye) = limit.places
            return _bilinear(receiver, *receiver.chart_coordinates(xs + part * (xe - xs), ys + part * (ye - ys)))
        case BeamAngleLimit():
            angles = _cut(receiver)
            turn = np.radians(limit.azimuth_deg)
            return _bilinear(receiver, *receiver.chart_coordinates(angles * np.cos(turn), angles * np.sin(turn)))
    inside = _zone(limit, receiver)
    if not inside.any():
        raise InputError(f"{where}: no pixel of the receiver lies in it; make it larger, or evaluate.pixels")
    pixels = np.flatnonzero(inside)
    ones = np.ones(len(pixels))
    shape = (len(pixels), inside.size)
    return sparse.csr_array((ones, (np.arange(len(pixels)), pixels)), shape=shape)


def _zone(limit: LimitSection, receiver: PosedReceiver) -> Bool[np.ndarray, "h w"]:
    """Pixels whose centres lie in a zone, or in the directions of a glare limit; within the window."""
    grid = receiver.grid
    x, y = receiver.target_coordinates(*np.meshgrid(grid.x(), grid.y()))
    inside = receiver.window.pixels(grid)
    if isinstance(limit, GlareLimit):
        inside &= np.hypot(x, y) >= limit.from_deg
    elif isinstance(limit, ZoneLimit) and limit.zone is not None:
        inside &= limit.zone.contains(*limit.zone.about_centre(x, y))
    return inside


def _cut(receiver: PosedReceiver) -> Float[np.ndarray, " k"]:
    """Angles (deg) from the axis along a cut through the far field."""
    half_deg = receiver.target_coordinates(np.array([receiver.window.radius]), np.array([0.0]))[0].item()
    steps = _STEPS_PER_PIXEL * max(receiver.grid.shape)
    return np.linspace(-half_deg, half_deg, steps + 1)


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
