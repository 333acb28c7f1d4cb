"""Light that targets and limits ask for, beside the most that any lens of the largest radius can bring there."""

from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from jaxtyping import Bool, Float

from lensforge.receivers.build import receivers_of
from lensforge.receivers.possible import LargestShare, PossibleLight, SourceLight
from lensforge.sources.build import summarise
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.spec.section import rounded_up
from lensforge.targets.limits import LightLimit, light_limits
from lensforge.targets.pattern import target_light
from lensforge.targets.region import in_target

LEAST_POSSIBLE = 0.5  # of what is asked for: with less, no search comes near it


@dataclass(frozen=True)
class AskedLight:
    """Light that a limit asks for at its worst place, and the most that is ``possible`` there, in ``unit``.

    ``radius_mm``: of the smallest lens whose étendue suffices. ``estimated``: the source's luminance is an estimate
    from its rays, which stops no search.
    """

    name: str
    asked: float
    possible: float
    unit: str
    radius_mm: float
    estimated: bool

    @property
    def met(self) -> float:
        """Largest part of what is asked."""
        return self.possible / self.asked

    @property
    def certain(self) -> bool:
        """False where the bound is that of an estimated luminance."""
        return not self.estimated

    @property
    def possible_words(self) -> str:
        """The bound in words."""
        return f"{_about(self.estimated)}at most {self.possible:.3g} {self.unit} (by étendue) can be reached"

    @property
    def asked_words(self) -> str:
        """The demand in words."""
        return f"{self.asked:g} {self.unit} that it asks for"

    def remedies(self) -> str:
        """Changes that would raise the bound."""
        return f"{_larger_lens(self.radius_mm)}, a smaller or brighter source, or a lower bound"


@dataclass(frozen=True)
class AskedShare:
    """Share of the source's flux that a target or a limit asks for, and its ``bounds``; all else as above.

    A target asks for all that two faces transmit into its bright part.
    """

    name: str
    asked: float
    bounds: LargestShare
    radius_mm: float
    estimated: bool

    @property
    def met(self) -> float:
        """Largest part of what is asked."""
        return self.bounds.value / self.asked

    @property
    def certain(self) -> bool:
        """False where only the bound of an estimated luminance is too low."""
        return not self.estimated or self.bounds.by_refraction < LEAST_POSSIBLE * self.asked

    @property
    def possible_words(self) -> str:
        """The bound in words."""
        return f"{_about(self.estimated)}{self.bounds} of the light can reach it"

    @property
    def asked_words(self) -> str:
        """The demand in words."""
        return f"{100.0 * self.asked:.3g} % that it asks for"

    def remedies(self) -> str:
        """Changes that would raise the bound."""
        if self.bounds.by_etendue <= self.bounds.by_refraction and isfinite(self.radius_mm):
            return f"{_larger_lens(self.radius_mm)}, a smaller source or a larger target"
        return "a larger lens.refractive_index, or a target nearer to the source's axis"


Asked = AskedLight | AskedShare


def asked_light(spec: Spec, source: Source) -> tuple[tuple[AskedShare, ...], tuple[Asked, ...]]:
    """The light asked for by the targets of each receiver, and by the limits of ``spec``.

    Raises :class:`InputError` for limits that contradict each other, or whose unit the source does not have.
    """
    light, receivers = SourceLight.of(source, spec.lens.media), receivers_of(spec, spec.evaluate.pixels)
    physics = [PossibleLight(light, receiver, spec.constraints.max_radius_mm) for receiver in receivers]
    wanted = [target_light(section.targets, each) for section, each in zip(spec.all_receivers, receivers, strict=True)]
    targets = tuple(_of_target(pattern, each) for pattern, each in zip(wanted, physics, strict=True))
    lumens_per_watt = summarise(source, spec.source).lumens_per_watt if spec.limits else None
    limits = light_limits(spec, receivers, lumens_per_watt, source.flux_w)
    found = (_of_limit(limit, physics[limit.receiver], source.flux_w) for limit in limits)
    return targets, tuple(each for each in found if each is not None)


def _of_target(wanted: Float[np.ndarray, "h w"], physics: PossibleLight) -> AskedShare:
    region = in_target(wanted)
    return _share("target", physics.light.transmittance * float(wanted[region].sum()), region, physics)


def _share(name: str, asked: float, region: Bool[np.ndarray, "h w"], physics: PossibleLight) -> AskedShare:
    estimated = physics.light.curve.estimated
    return AskedShare(name, asked, physics.in_region(region), physics.radius_for(region, asked), estimated)


def _of_limit(limit: LightLimit, physics: PossibleLight, flux_w: float) -> Asked | None:
    """The share, or the light at the place at which least of it is possible; None for other limits, and upper ones."""
    if limit.sense != ">=" or limit.quantity not in ("light", "share"):
        return None
    if limit.quantity == "share":
        region = np.zeros(physics.on_pixels.shape, dtype=bool)
        region.flat[limit.readings.indices] = True
        return _share(limit.name, limit.bound, region, physics)
    possible = float(limit.of(physics.on_pixels[None] * flux_w).min())
    radius_mm = physics.max_radius_mm * sqrt(limit.bound / max(possible, np.finfo(float).tiny))
    return AskedLight(limit.name, limit.bound, possible, limit.unit, radius_mm, physics.light.curve.estimated)


def _about(estimated: bool) -> str:
    return "by an estimate of the source's luminance " if estimated else ""


def _larger_lens(radius_mm: float) -> str:
    return f"a larger lens (>= {rounded_up(radius_mm)} mm)"
