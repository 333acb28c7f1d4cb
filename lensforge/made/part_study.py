"""Parts of one lens, measured one by one by the same rays, from a small recipe that has everything a worker needs.

The metrics of a part depend on the recipe, its number and its scales alone, and so are the same bits wherever and
whenever they are computed.

Parts share their rays with the lens as designed, so that most of the ray noise cancels in the change from it. A metric
of a part is that of the lens as designed, by many rays, plus this change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.wall import thinnest_of
from lensforge.errors import InputError
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light
from lensforge.light.metrics import Images
from lensforge.light.receiver_light import judged_figures
from lensforge.light.simulation import TracedLens
from lensforge.made.board_light import (
    BoardLight,
    common_to_lamps,
    designed_pictures,
    in_plate,
    periods_of,
    pictures_of,
)
from lensforge.made.part_light import MeasuredPart, PartLight, ReplicateRays
from lensforge.made.tolerance_result import MetricBound
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.results import Metric
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.lens import Lens
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.made_part import MadePart, PartMaker
from lensforge.scene.perturbations import Deviations, Draws
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.measured_rays import held_back
from lensforge.sources.ray_bundle import Source
from lensforge.spec.accuracy import preset_of
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.tolerances_section import Factor, factor_name, factors_of
from lensforge.surfaces.srbf import fibonacci_hemisphere

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
        return factors_of(self.recipe.lens.spec.part_tolerances)

    @cached_property
    def draws(self) -> Draws:
        """Numbers of every part, by lamp. Raises :class:`InputError` for too many of them."""
        parts, lamps, factors = self.recipe.parts, len(self.lamps), self.factors
        if parts * lamps * sum(factor.numbers for factor in factors) > _MOST_NUMBERS:
            raise InputError(f"yield: {parts} parts of {lamps} lamps are more than fit in memory; take fewer parts")
        return Draws.of(factors, parts, self.recipe.seed, lamps, common_to_lamps(self.recipe.lens.spec))

    @cached_property
    def boards(self) -> tuple[LampPictures, ...]:
        """Each receiver, of an infinite lattice that of a patch."""
        spec = self.recipe.lens.spec
        return tuple(pictures_of(each, periods_of(spec)) for each in receivers_of(spec, spec.evaluate.pixels))

    @cached_property
    def lamps(self) -> Lamps:
        """Lamps of each part, which are drawn apart."""
        lamps = self.recipe.lens.spec.all_lamps
        return lamps if lamps.period_mm is None else self.boards[0].receiver.lamps

    @cached_property
    def designed_pictures(self) -> list[list[Images]]:
        """Pictures of one lamp as designed, by many rays, where several are drawn apart; none of one alone."""
        if self.lamps.is_single:
            return []
        rays, seed = self.recipe.designed_rays, self.recipe.seed
        return designed_pictures(self._nominal, held_back(self._source), self.boards, rays, seed)

    @cached_property
    def _nominal(self) -> TracedLens:
        """Tables of the search, not of an evaluation: their error is in the part and in the lens as designed alike."""
        lens = self.recipe.lens
        return TracedLens.of(lens, preset_of(lens.accuracy).nodes_per_sigma)

    @cached_property
    def limits(self) -> tuple[LightLimit, ...]:
        """Limits of the spec on its receivers."""
        spec, source = self.recipe.lens.spec, self._source
        efficacy = summarise(source, spec.source).lumens_per_watt
        return light_limits(spec, receivers_of(spec, spec.evaluate.pixels), efficacy, source.flux_w)

    @cached_property
    def _source(self) -> Source:
        return build_source(self.recipe.lens.spec.source, self.recipe.lens.dispersion)

    @cached_property
    def light(self) -> PartLight:
        """Receivers, limits and rays."""
        recipe, spec = self.recipe, self.recipe.lens.spec
        held = ReplicateRays.of(held_back(self._source), recipe.rays, recipe.seed)
        light = PartLight(spec, self._nominal, receivers_of(spec, spec.evaluate.pixels), self.limits, held)
        return light if self.lamps.is_single else BoardLight.of(light, self.boards, self.designed_pictures)

    @cached_property
    def maker(self) -> PartMaker:
        """Tables of the form errors."""
        lens, grid = self.recipe.lens, self.light.nominal.scene.grid
        return PartMaker.of(lens.spec, lens.surfaces, grid, self.factors)

    @cached_property
    def designed(self) -> MeasuredPart:
        """The lens as designed, by the rays of the parts."""
        return self.light.measured(self.light.received(None))

    @cached_property
    def designed_light(self) -> Light:
        """The light of the lens as designed, by many rays."""
        lens, recipe = self.recipe.lens, self.recipe
        traced = TracedLens.of(lens, preset_of(lens.accuracy).evaluate_nodes_per_sigma)
        judging, rays = held_back(self._source), recipe.designed_rays
        limits = self.limits
        return evaluate_traced(traced, lens.spec, judging, rays, recipe.seed, limits=limits, bounds_by=self._source)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the metrics: those of the first receiver, of the others with theirs, and of the limits."""
        *receivers, limits = self._changes(self.designed)
        found = []
        for number, (each, light) in enumerate(zip(receivers, self.designed_light.receivers, strict=True)):
            found += [f"{light.name}: {name}" if number else name for name in each]
        judged = [self.designed_light.limits[int(key)] for key in limits]
        plain = [f"{limit.label}: {limit.note}" for limit in judged]
        sides = [f"{limit.label}: {limit.note} ({_SIDES[limit.sense]})" for limit in judged]
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
        found += [limit.metric for limit in self.designed_light.limits]
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
            for name, figure in judged_figures(each, transmittance_of(lens.media)).items():
                found.append(MetricBound(metric=f"{prefix}{name}", sense=figure.sense, bound=figure.bound, unit=""))
        return tuple(found)

    def with_rays(self, rays: int) -> "PartStudy":
        """Study with other ``rays`` for each part; what does not depend on them is kept."""
        other = PartStudy(replace(self.recipe, rays=rays))
        for name in ("draws", "maker", "designed_light", "boards", "designed_pictures"):
            other.__dict__[name] = getattr(self, name)
        return other

    def part(self, number: int, scales: Scales | None = None) -> tuple[MadePart, ...]:
        """One part, some of its deviations scaled: the lens of each of its lamps."""
        return self.made([self.draws.deviations(number, scales, lamp) for lamp in range(len(self.lamps))])

    def made(self, found: Sequence[Deviations]) -> tuple[MadePart, ...]:
        """The lenses of a part with these deviations, one after the other."""
        if self.recipe.lens.spec.plate is not None:
            found = [in_plate(each, lamp) for each, lamp in zip(found, self.lamps.lamps, strict=True)]
        return tuple(map(self.maker.part, found))

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
        return np.asarray(signs * (values[..., columns] - limits))


_MOST_NUMBERS = 2**27  # 1 GiB
_DIRECTIONS = 4000
# Farthest that a drawn number lies: a normal one beyond twice its amount in one part of 30,000.
_FARTHEST = {"uniform": 1.0, "truncated": 1.0, "normal": 2.0}
_RMS_TO_PEAK = 3.0
_OF_FACE = ("shift_mm", "gap_mm", "tilt_deg", "form_um", "waviness_um")  # that bring it nearer to another face
_OF_SOURCE = ("source_shift_mm", "source_height_mm", "source_tilt_deg", "source_size")
_OF_LENS = ("lens_shift_mm", "lens_height_mm", "lens_tilt_deg")


def require_feasible_tolerances(lens: Lens, factors: Sequence[Factor]) -> None:
    """Refuse a tolerance that alone brings the faces together, or the source to the cavity.

    Raises :class:`InputError`, which names the tolerance and what is left for it.
    """
    cavity, envelope = lens_boundaries(lens)
    wall = thinnest_of(lens).thickness_mm
    reach = float(envelope.radius(fibonacci_hemisphere(_DIRECTIONS)).max())
    points = build_source(lens.spec.source, lens.dispersion).outline()
    distance = np.linalg.norm(points, axis=1)
    along = points / np.where(distance > 0.0, distance, 1.0)[:, None]
    along[distance == 0.0] = (0.0, 0.0, 1.0)
    along[:, 2] = np.maximum(along[:, 2], 0.0)  # light from below z = 0 enters through the opening: judged in it
    along /= np.linalg.norm(along, axis=1)[:, None]
    room = float((cavity.radius(along) - distance).min())
    size = float(distance.max())
    roles, nearest = lens.spec.lens.roles, " or ".join(face.name for face in lens.body.cavity)
    of_faces = [factor_name(roles, role.name, each) for role in roles for each in _OF_FACE]
    from_source = f"the source is {room:.3g} mm from the {nearest} face at its closest"
    bounds = [
        (of_faces, wall, reach, f"the faces are {wall:.3g} mm apart at their closest"),
        ((*_OF_SOURCE, *_OF_LENS), room, size, from_source),
    ]
    if lens.spec.plate is not None:  # its lenses move as far as they stand from its middle
        middle = lens.spec.plate.lenses(lens.spec.lamps).reach_mm
        bounds.append((["shrinkage", "lens_tilt_deg"], room, middle, from_source))
    for factor in factors:
        for names, left, arm, words in bounds:
            moved = displacement(factor, arm)
            if factor.name in names and moved >= left > 0.0:
                most = factor.amount * left / moved
                raise InputError(
                    f"tolerances.{factor.name} = {factor.amount:g}: parts at its end move by {moved:.3g} mm, but "
                    f"{words}; at most {most:.2g}"
                )


def displacement(factor: Factor, arm_mm: float) -> float:
    """Farthest (mm) that a point at ``arm_mm`` moves by the factor."""
    if factor.kind == "field":
        return _RMS_TO_PEAK * factor.amount * factor.to_internal
    far = _FARTHEST[factor.distribution] * factor.amount * factor.to_internal * float(np.sqrt(factor.numbers))
    return far * arm_mm if factor.unit in ("deg", "") else far
