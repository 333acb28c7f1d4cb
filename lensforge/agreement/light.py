"""Agreement of a simulated light with its own pictures: flux budget, metrics, and what noise may take off."""

from collections.abc import Iterator

import numpy as np

from lensforge.agreement.comparing import beyond, differing, judged, unlike
from lensforge.evaluation.light import Light, light_criteria
from lensforge.evaluation.metrics import nmse, relative_deviation, uniformity
from lensforge.lens import Lens
from lensforge.spec.target import IN_TARGET

# NMSE of the picture less that of the light is the noise in the picture; in the shipped examples to 2 %. An estimate
# from replicates scatters by its standard error. Anything beyond ten times both is no noise.
_NOISES, _ERRORS = 10.0, 10.0
_EDGE = 1e-9  # pixels as bright as the border of the target count either way
_PICTURES = "its pictures"


def light_contradictions(light: Light, lens: Lens) -> Iterator[str]:
    """Contradictions of the record of a light."""
    flux = light.flux
    yield from _scene(light, lens)
    yield from judged("criteria", light.criteria, light_criteria(flux))
    missed = sum(light.missed_by_cause.model_dump().values())
    yield from differing("flux.missed", flux.missed, missed, "its causes")
    yield from differing("efficiency", light.efficiency.value, flux.detected, "its shares of flux")
    yield from beyond("share_in_target", light.share_in_target.value, 0.0, flux.detected + flux.outside, "its flux")
    yield from _share(light)
    yield from _pictures(light)
    yield from _noise(light)


def _scene(light: Light, lens: Lens) -> Iterator[str]:
    """Settings of the spec that the record repeats, where it names no other conditions."""
    spec, other = lens.spec, light.conditions
    pixels, seed = (None, None) if other is None else (other.pixels, other.seed)
    for name, wanted in (
        ("pixels", pixels or spec.evaluate.pixels),
        ("seed", lens.seed if seed is None else seed),
        ("receiver_mm", spec.target.receiver_mm),
        ("window_mm", spec.evaluate.window_mm or spec.target.receiver_mm),
        ("uniform_mm", spec.target.uniform_mm),
        ("distance_mm", spec.target.distance_mm),
    ):
        yield from unlike(name, getattr(light, name), wanted, "spec and conditions have")


def _share(light: Light) -> Iterator[str]:
    """The share in the target to the efficiency, where the window is the whole receiver, is that of the pictures."""
    total, wanted = float(light.raw_map.sum()), light.target_map
    if light.window_mm != light.receiver_mm or not total > 0.0:  # the efficiency is that of the window
        return
    border = IN_TARGET * wanted.max()
    most, least = (float(light.raw_map[wanted > border * (1.0 + side)].sum()) / total for side in (-_EDGE, _EDGE))
    landed = light.efficiency.value
    yield from beyond("share_in_target", light.share_in_target.value, least * landed, most * landed, _PICTURES)


def _pictures(light: Light) -> Iterator[str]:
    """Metrics with noise are those of the picture, and the target is scaled to its flux."""
    seen, raw = light.map, light.raw
    yield from differing("target_map", float(light.target_map.sum()), float(seen.sum()), _PICTURES)
    if not float(light.target_map.sum()) > 0.0 and float(seen.sum()) > 0.0:
        yield "target_map: dark"
        return
    yield from differing("raw.nmse", raw.nmse, nmse(seen, light.target_map), _PICTURES)
    inside = np.abs(light.axis_mm) <= 0.5 * (light.uniform_mm or 0.0)
    mask = inside[:, None] & inside[None, :]
    judge = light.uniform_mm is not None and bool(mask.any()) and float(seen.sum()) > 0.0
    yield from differing("raw.uniformity", raw.uniformity, uniformity(seen, mask) if judge else None, _PICTURES)
    yield from differing("raw.rsd", raw.rsd, relative_deviation(seen, mask) if judge else None, _PICTURES)
    for name, metric, known in (("uniformity", light.uniformity, raw.uniformity), ("rsd", light.rsd, raw.rsd)):
        if (metric is None) != (known is None):
            yield f"{name}: {'missing' if metric is None else 'given'}, but not so in raw"


def _noise(light: Light) -> Iterator[str]:
    """The NMSE of the light is that of its picture, less noise."""
    error, noise = light.nmse.standard_error, light.nmse_of_noise
    if error is None or noise is None:
        yield from differing("nmse", light.nmse.value, light.raw.nmse, _PICTURES)
        return
    least = light.raw.nmse - _NOISES * noise - _ERRORS * error
    yield from beyond("nmse", light.nmse.value, least, np.inf, "its pictures and their noise")
