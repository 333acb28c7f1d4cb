"""Agreement of a simulated light with its own pictures: flux budget, metrics, and what noise may take off."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from lensforge.agreement.comparing import beyond, differing, judged, unlike
from lensforge.errors import InputError
from lensforge.evaluation.light import Light, light_criteria
from lensforge.evaluation.metrics import nmse, relative_deviation, uniformity
from lensforge.evaluation.receiver_light import ReceiverLight
from lensforge.evaluation.region_light import bright_region
from lensforge.lens import Lens
from lensforge.lens_at_temperature import at_temperature
from lensforge.optics.two_refractions import transmittance_of
from lensforge.spec import AnyReceiver
from lensforge.spec.ray_source import RayfileSource, RayfilesSource, RaySource

if TYPE_CHECKING:
    from lensforge.receivers.posed import PosedReceiver

# NMSE of the picture less that of the light is the noise in the picture; in the shipped examples to 2 %. An estimate
# from replicates scatters by its standard error. Anything beyond ten times both is no noise.
_NOISES, _ERRORS = 10.0, 10.0
_EDGE = 1e-9  # pixels as bright as the border of the target count either way
_PICTURES = "its pictures"


def light_contradictions(light: Light, lens: Lens) -> Iterator[str]:
    """Contradictions of the record of a light."""
    from lensforge.receivers.build import receivers_of

    yield from _settings(light, lens)
    yield from judged("criteria", light.criteria, light_criteria(light.flux))
    sections = lens.spec.all_receivers
    yield from unlike("receivers", len(light.receivers), len(sections), "the spec has")
    built = receivers_of(lens.spec, light.pixels)
    for own, section, receiver in zip(light.receivers, sections, built, strict=False):
        for words in _of_receiver(own, section, receiver):
            yield words if len(sections) == 1 else f"receivers: {section.name}: {words}"
    yield from _possible(light, lens, built)
    if not any(own.map.shape != receiver.grid.shape for own, receiver in zip(light.receivers, built, strict=False)):
        yield from _limits(light, lens, built)


def _possible(light: Light, lens: Lens, receivers: "tuple[PosedReceiver, ...]") -> Iterator[str]:
    """Bounds of physics that the verdict rests on, and that are not those of the source.

    Those below what two faces transmit; of the spec's own source, and not of ray files, which would be read each time.
    """
    from lensforge.receivers.possible import PossibleLight, SourceLight
    from lensforge.sources.build import build_source
    from lensforge.targets.pattern import drawn_target

    asked = [transmittance_of(lens.media) * own.wanted_in_target for own in light.receivers]
    lower = [own.possible.share_in_target < most for own, most in zip(light.receivers, asked, strict=True)]
    other = light.conditions is not None and light.conditions.source is not None
    if other or not any(lower) or isinstance(lens.spec.source, RayfileSource | RayfilesSource | RaySource):
        return
    celsius = None if light.conditions is None else light.conditions.temperature_c
    try:
        body = lens if celsius is None else at_temperature(lens, celsius)
    except InputError as error:
        yield f"conditions: {error}"
        return
    source = SourceLight.of(build_source(lens.spec.source, body.dispersion), body.media)
    of_spec = zip(light.receivers, lens.spec.all_receivers, receivers, lower, strict=False)
    for own, section, receiver, rests in of_spec:
        if rests and own.target_map.shape == receiver.grid.shape:
            physics = PossibleLight(source, receiver, body.reach_mm)
            found = physics.in_region(drawn_target(section.targets, receiver).coverage).value
            yield from differing("possible.share_in_target", own.possible.share_in_target, found, "source and lens")


def _limits(light: Light, lens: Lens, receivers: "tuple[PosedReceiver, ...]") -> Iterator[str]:
    """Limits that are not those of the spec, or values that the pictures do not have."""
    from lensforge.evaluation.limits import limit_value
    from lensforge.targets.limits import light_limits

    if not (lens.spec.limits or light.limits):
        return
    # the pictures hold light, not flux; a share is one of the flux in W, which no field of the record states
    wanted = light_limits(lens.spec, receivers, light.lumens_per_watt or 1.0, 1.0)
    yield from unlike("limits", len(light.limits), len(wanted), "the spec has")
    for own, limit in zip(light.limits, wanted, strict=False):
        where = f"limits: {limit.name}"
        for name in ("name", "sense", "bound", "unit"):
            yield from unlike(f"{where}: {name}", getattr(own, name), getattr(limit, name), "the spec has")
        lit = light.receivers[limit.receiver]
        yield from unlike(f"{where}: receiver", own.receiver, lit.name, "the spec has")
        if limit.quantity == "share":
            continue
        value = limit_value(limit, lit.map[None] * receivers[limit.receiver].pixel_measure).value
        room = _ERRORS * (own.value.standard_error or 0.0) + _EDGE * abs(value)
        yield from beyond(f"{where}: value", own.value.value, value - room, value + room, _PICTURES)


def _settings(light: Light, lens: Lens) -> Iterator[str]:
    """Settings of the spec that the record repeats, where it names no other conditions."""
    other = light.conditions
    pixels, seed = (None, None) if other is None else (other.pixels, other.seed)
    for name, wanted in (
        ("pixels", pixels or lens.spec.evaluate.pixels),
        ("seed", lens.seed if seed is None else seed),
    ):
        yield from unlike(name, getattr(light, name), wanted, "spec and conditions have")


def _of_receiver(light: ReceiverLight, section: AnyReceiver, receiver: "PosedReceiver") -> Iterator[str]:
    """Contradictions of the light on one receiver."""
    flux = light.flux
    yield from _place(light, section, receiver)
    missed = sum(light.missed_by_cause.model_dump().values())
    yield from differing("flux.missed", flux.missed, missed, "its causes")
    yield from differing("efficiency", light.efficiency.value, flux.detected, "its shares of flux")
    yield from beyond("share_in_target", light.share_in_target.value, 0.0, flux.detected + flux.outside, "its flux")
    if any(image.shape != receiver.grid.shape for image in (light.map, light.raw_map, light.target_map)):
        rows, columns = receiver.grid.shape
        yield f"map: {light.map.shape[1]} x {light.map.shape[0]} pixels, but the spec has {columns} x {rows}"
        return
    yield from _share(light, section, receiver)
    yield from _pictures(light, section, receiver)
    yield from _noise(light)


def _place(light: ReceiverLight, section: AnyReceiver, receiver: "PosedReceiver") -> Iterator[str]:
    """Name, kind, place and size of the receiver, which the record repeats."""
    for name in ("name", "kind", "place"):
        yield from unlike(name, getattr(light, name), getattr(section, name), "the spec has")
    for name in ("width", "height"):
        yield from differing(name, getattr(light, name), getattr(receiver.grid, name), "the spec's lengths")
    for name in ("width", "height", "radius"):
        wanted = getattr(receiver.window, name)
        known = wanted if np.isfinite(wanted) else None
        yield from differing(f"window.{name}", getattr(light.window, name), known, "the spec's lengths")


def _share(light: ReceiverLight, section: AnyReceiver, receiver: "PosedReceiver") -> Iterator[str]:
    """The share in the target to the efficiency, where the window is the whole receiver, is that of the pictures."""
    from lensforge.targets.pattern import drawn_target

    total, window = float(light.raw_map.sum()), receiver.window
    whole = (window.width, window.height) == receiver.grid.size and not np.isfinite(window.radius)
    if not whole or not total > 0.0:  # the efficiency is that of the window
        return
    drawn = drawn_target(section.targets, receiver)
    seen, covered = light.target_map, drawn.coverage
    if not np.allclose(seen, drawn.light * seen.sum(), rtol=0.0, atol=1e-6 * float(seen.max())):
        return  # not the target of the spec: nothing is known of its edges
    most, least = (float(light.raw_map[inside].sum()) / total for inside in (covered > 0.0, covered == 1.0))
    landed = light.efficiency.value
    low, high = least * landed * (1.0 - _EDGE), most * landed * (1.0 + _EDGE)
    yield from beyond("share_in_target", light.share_in_target.value, low, high, _PICTURES)


def _pictures(light: ReceiverLight, section: AnyReceiver, receiver: "PosedReceiver") -> Iterator[str]:
    """Metrics with noise are those of the picture, and the target is scaled to its flux."""
    from lensforge.targets.region import uniform_region

    seen, raw = light.map, light.raw
    yield from differing("target_map", float(light.target_map.sum()), float(seen.sum()), _PICTURES)
    if not float(light.target_map.sum()) > 0.0 and float(seen.sum()) > 0.0:
        yield "target_map: dark"
        return
    yield from differing("raw.nmse", raw.nmse, nmse(seen, light.target_map), _PICTURES)
    mask = uniform_region(section.targets, receiver)
    if mask is not None and not (mask.any() and float(seen.sum()) > 0.0):
        mask = None
    even, spread = (None, None) if mask is None else (uniformity(seen, mask), relative_deviation(seen, mask))
    yield from differing("raw.uniformity", raw.uniformity, even, _PICTURES)
    yield from differing("raw.rsd", raw.rsd, spread, _PICTURES)
    for name, metric, known in (("uniformity", light.uniformity, raw.uniformity), ("rsd", light.rsd, raw.rsd)):
        if (metric is None) != (known is None):
            yield f"{name}: {'missing' if metric is None else 'given'}, but not so in raw"
    yield from _region(light, mask)


def _region(light: ReceiverLight, mask: Bool[np.ndarray, "h w"] | None) -> Iterator[str]:
    """Mean light of the region is that of the picture; the least is below it, the largest above."""
    found = light.in_region
    if found is None:
        return
    yield from unlike(
        "in_region.region", found.region, "bright" if mask is None else "uniform", "the spec names one of"
    )
    inside = bright_region(light.target_map) if mask is None else mask
    yield from differing("in_region.mean", found.mean.value, float(light.map[inside].mean()), _PICTURES)
    error = np.hypot(found.u0.standard_error or 0.0, found.u1.standard_error or 0.0)
    most = found.u0.value + _ERRORS * error + _EDGE  # least over largest, but each without noise of its own
    yield from beyond("in_region.u1", found.u1.value, -np.inf, float(most), "its uniformity U0")


def _noise(light: ReceiverLight) -> Iterator[str]:
    """The NMSE of the light is that of its picture, less noise."""
    error, noise = light.nmse.standard_error, light.nmse_of_noise
    if error is None or noise is None:
        yield from differing("nmse", light.nmse.value, light.raw.nmse, _PICTURES)
        return
    least = light.raw.nmse - _NOISES * noise - _ERRORS * error
    yield from beyond("nmse", light.nmse.value, least, np.inf, "its pictures and their noise")
