"""Parts of one lens, measured one by one: everything that a worker needs, made from a small recipe.

The metrics of a part depend on the recipe, its number and its scales alone, and so are the same bits wherever and
whenever they are computed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.deviations.draws import Draws
from lensforge.deviations.factors import Factor, factors_of
from lensforge.deviations.made_part import MadePart, PartMaker
from lensforge.evaluation.evaluate import evaluate_traced
from lensforge.evaluation.light import Light
from lensforge.evaluation.light_bounds import LARGEST_NMSE, LEAST_SHARE, possible_share
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.optics.two_refractions import transmittance_of
from lensforge.receivers.build import receivers_of
from lensforge.records import Metric
from lensforge.sources.build import build_source, summarise
from lensforge.sources.measured_rays import held_back
from lensforge.targets.limits import light_limits
from lensforge.tolerancing.part_light import HeldLight, MeasuredPart, PartLight
from lensforge.tolerancing.yield_result import MetricBound

Scales = Mapping[str, float]
_SIDES = {">=": "least", "<=": "most"}


@dataclass(frozen=True)
class Recipe:
    """All that decides the metrics of every part of a study."""

    lens: Lens
    parts: int
    rays: int
    seed: int
    designed_rays: int


@dataclass(frozen=True, eq=False)
class PartStudy:
    """A recipe with all that is made from it, once in each process."""

    recipe: Recipe

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """The tolerances of the spec."""
        return factors_of(self.recipe.lens.spec.tolerances)

    @cached_property
    def draws(self) -> Draws:
        """Numbers of every part."""
        return Draws.of(self.factors, self.recipe.parts, self.recipe.seed)

    @cached_property
    def light(self) -> PartLight:
        """Receivers, limits and rays."""
        lens, recipe = self.recipe.lens, self.recipe
        source, spec = build_source(lens.spec.source, lens.dispersion), lens.spec
        receivers = receivers_of(spec, spec.evaluate.pixels)
        efficacy = summarise(source, spec.source).lumens_per_watt
        limits = light_limits(spec, receivers, efficacy, source.flux_w)
        # tables of the search, not of an evaluation: their error is in the part and in the lens as designed alike
        nominal = TracedLens.of(lens, PRESETS[lens.accuracy].nodes_per_sigma)
        held = HeldLight.of(held_back(source), recipe.rays, recipe.seed)
        return PartLight(spec, nominal, receivers, limits, held)

    @cached_property
    def maker(self) -> PartMaker:
        """Tables of the form errors."""
        return PartMaker.of_lens(self.recipe.lens, self.light.nominal.scene.grid, self.factors)

    @cached_property
    def designed(self) -> MeasuredPart:
        """The lens as designed, by the rays of the parts."""
        return self.light.measured(self.light.received(None))

    @cached_property
    def designed_light(self) -> Light:
        """The light of the lens as designed, by many rays."""
        lens, recipe = self.recipe.lens, self.recipe
        source = build_source(lens.spec.source, lens.dispersion)
        traced = TracedLens.of(lens, PRESETS[lens.accuracy].evaluate_nodes_per_sigma)
        judging, rays = held_back(source), recipe.designed_rays
        limits = self.light.limits
        return evaluate_traced(traced, lens.spec, judging, rays, recipe.seed, limits=limits, bounds_by=source)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the metrics: those of the first receiver, of the others with theirs, and of the limits."""
        *receivers, limits = self._changes(self.designed)
        found = []
        for number, (each, light) in enumerate(zip(receivers, self.designed_light.receivers, strict=True)):
            found += [f"{light.name}: {name}" if number else name for name in each]
        judged = [self.designed_light.limits[int(key)] for key in limits]
        plain = [f"{limit.name}: {limit.quantity}" for limit in judged]
        sides = [f"{limit.name}: {limit.quantity} ({_SIDES[limit.sense]})" for limit in judged]
        for number, (name, side) in enumerate(zip(plain, sides, strict=True)):
            alike = sides[:number].count(side)  # limits may share their name
            own = side if plain.count(name) > 1 else name
            found.append(f"{own} {alike + 1}" if alike else own)
        return tuple(found)

    @cached_property
    def of_design(self) -> dict[str, Metric]:
        """Metrics of the lens as designed, by many rays."""
        found: list[Metric] = []
        *receivers, _ = self._changes(self.designed)
        for each, light in zip(receivers, self.designed_light.receivers, strict=True):
            found += [getattr(light, name) or Metric(value=0.0) for name in each]
        found += [limit.value for limit in self.designed_light.limits]
        return dict(zip(self.names, found, strict=True))

    @cached_property
    def bounds(self) -> tuple[MetricBound, ...]:
        """Bounds that a part must keep: the limits of the spec or, without any, what the verdict on the light asks."""
        lens, light = self.recipe.lens, self.designed_light
        if light.limits:
            names = self.names[-len(light.limits) :]
            return tuple(
                MetricBound(metric=name, sense=limit.sense, bound=limit.bound, unit=limit.unit)
                for name, limit in zip(names, light.limits, strict=True)
            )
        found = []
        for number, each in enumerate(light.receivers):
            prefix = f"{each.name}: " if number else ""
            least = LEAST_SHARE * possible_share(each, transmittance_of(lens.media))[0]
            found.append(MetricBound(metric=f"{prefix}nmse", sense="<=", bound=LARGEST_NMSE, unit=""))
            found.append(MetricBound(metric=f"{prefix}share_in_target", sense=">=", bound=least, unit=""))
        return tuple(found)

    def with_rays(self, rays: int) -> "PartStudy":
        """The same study with other ``rays`` of each part; what does not depend on them is kept."""
        other = PartStudy(replace(self.recipe, rays=rays))
        for name in ("draws", "maker", "designed_light"):
            other.__dict__[name] = getattr(self, name)
        return other

    def part(self, number: int, scales: Scales | None = None) -> MadePart:
        """One part, some of its deviations scaled."""
        return self.maker.part(self.draws.deviations(number, scales))

    def measure(self, number: int, scales: Scales | None = None) -> Float[np.ndarray, "m 2"]:
        """Metrics of one part, in the order of ``names``, and the standard error of each one's change by its errors."""
        found = self.light.measured(self.light.received(self.part(number, scales)))
        changes = [each for group in self._changes(found) for each in group.values()]
        designed = [metric.value for metric in self.of_design.values()]
        errors = [change.standard_error or 0.0 for change in changes]
        return np.array([[value + change.value for value, change in zip(designed, changes, strict=True)], errors]).T

    def _changes(self, part: MeasuredPart) -> list[dict[str, Metric]]:
        """Metrics of ``part`` against those of the lens as designed."""
        return part.change_from(self.designed, self.recipe.rays, self.designed_light.receivers)

    def excess(self, values: Float[np.ndarray, "*n m"]) -> Float[np.ndarray, "*n b"]:
        """Distance of the metrics from each bound, above 0 on its wrong side."""
        columns = [self.names.index(bound.metric) for bound in self.bounds]
        signs = np.array([1.0 if bound.sense == "<=" else -1.0 for bound in self.bounds])
        limits = np.array([bound.bound for bound in self.bounds])
        found: Float[np.ndarray, "*n b"] = signs * (values[..., columns] - limits)
        return found
