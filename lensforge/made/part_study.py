"""Parts of one lens, measured one by one in every state of its spec, by the same rays, from a small recipe.

The metrics of a part depend on the recipe, its number and its scales alone, and so are the same bits wherever and
whenever they are computed. In each state a part is the same: its lens, and by how much the LED is off.

Parts share their rays with the lens as designed, so that most of the ray noise cancels in the change from it. A metric
of a part is that of the lens as designed, by many rays, plus this change.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, repeat

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.kernels.parallel import in_parallel_map
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light
from lensforge.light.far_field import limits_by_intensities
from lensforge.light.replicate_rays import ReplicateRays
from lensforge.light.simulation import TracedLens
from lensforge.made.board_light import (
    BoardLight,
    LensOnBoard,
    common_to_lamps,
    designed_pictures,
    in_plate,
    periods_of,
    pictures_of,
)
from lensforge.made.part_light import Channels, MeasuredPart, PartLight, judged_colour
from lensforge.made.tolerance_result import LimitChange, MetricBound
from lensforge.optics.efficacy import Efficacy
from lensforge.results import Fact, Metric
from lensforge.results.estimates import scaled
from lensforge.results.figure import limits_in
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.lens import Lens
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.limit_views import LimitView, limit_views
from lensforge.scene.made_part import MadePart, PartMaker
from lensforge.scene.perturbations import Deviations, Draws
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.build_source import build_source
from lensforge.sources.joined_spectrum import efficacy_of
from lensforge.sources.measured_rays import held_back
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import preset_of
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.tolerances_section import Factor, factors_of

Scales = Mapping[str, float]
_SIDES = {">=": "least", "<=": "most"}
_OF_ANY_RAYS = ("draws", "receivers", "boards", "kinds")  # of a study, however many rays it takes
_OF_ANY_RAYS_BY_LED = ("limits", "designed_light", "designed_pictures")


@dataclass(frozen=True)
class Recipe:
    """Everything that determines the metrics of every part of a study."""

    lens: Lens
    parts: int
    rays: int
    seed: int
    designed_rays: int


@dataclass(frozen=True, eq=False)
class PartStudy:
    """A recipe with everything derived from it, once in each process."""

    recipe: Recipe

    @property
    def spec(self) -> Spec:
        """The spec of the lens."""
        return self.recipe.lens.spec

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """The tolerances of the spec."""
        return factors_of(self.spec.part_tolerances)

    @cached_property
    def draws(self) -> Draws:
        """Numbers of every part, by lamp. Raises :class:`InputError` for too many of them."""
        parts = self.recipe.parts
        lamps = len(self.lamps)
        factors = self.factors
        if parts * lamps * sum(factor.numbers for factor in factors) > _MOST_NUMBERS:
            raise InputError(f"yield: {parts} parts of {lamps} lamps are more than fit in memory; take fewer parts")
        return Draws.of(factors, parts, self.recipe.seed, lamps, common_to_lamps(self.spec))

    @cached_property
    def receivers(self) -> tuple[PosedReceiver, ...]:
        """Receivers of the spec."""
        return receivers_of(self.spec, self.spec.evaluate.pixels)

    @cached_property
    def boards(self) -> tuple[LampPictures, ...]:
        """Pictures of a whole board on each receiver; of an infinite lattice those of one of its patches."""
        return tuple(pictures_of(receiver, periods_of(self.spec)) for receiver in self.receivers)

    @cached_property
    def lamps(self) -> Lamps:
        """Lamps of each part, which are drawn apart."""
        lamps = self.spec.all_lamps
        return lamps if lamps.period_mm is None else self.boards[0].receiver.lamps

    @cached_property
    def kinds(self) -> tuple[LensOnBoard, ...]:
        """The lens of each kind with its lamps, one where all lamps have the same."""
        traced = TracedLens.of(self.recipe.lens, preset_of(self.recipe.lens.accuracy).nodes_per_sigma)
        lenses = []
        lamps = self.lamps
        for kind, lens, lamps_of_kind in zip(
            lamps.kinds or [None], self.recipe.lens.kinds, traced.kinds or [traced], strict=True
        ):
            boards = self.boards
            numbers = tuple(range(len(lamps)))
            if kind is not None:
                alone = (replace(receiver, lamps=lamps.of_kind(kind)) for receiver in self.receivers)
                boards = tuple(map(LampPictures.of, alone))
                numbers = kind.numbers
            maker = PartMaker.of(lens.spec, lens.surfaces, lamps_of_kind.scene.grid, self.factors)
            lenses.append(LensOnBoard(lens, lamps_of_kind, maker, numbers, boards))
        return tuple(lenses)

    @cached_property
    def leds(self) -> "tuple[LedStudy, ...]":
        """The study in each state, such as with each LED.

        Raises :class:`InputError` for states whose light cannot be measured beside that of the first.
        """
        by_state = self.recipe.lens.by_state
        studies = tuple(LedStudy(self, lens, name if len(by_state) > 1 else "") for name, lens in by_state.items())
        differing = [name for name, lens in by_state.items() if lens.spec.all_receivers != self.spec.all_receivers]
        if differing and not self.lamps.is_single:
            raise InputError(
                f"yield: the state {differing[0]!r} has a target of its own, and parts of several lamps are measured "
                "on one; study one state, lens.of_state(name), or one lamp"
            )
        if len({study.receivers[0].grid.shape for study in studies}) > 1:
            raise InputError(
                "yield: the first receivers of the states differ in their numbers of rows and columns; give them one "
                "ratio of width and height, or study one state, lens.of_state(name)"
            )
        return studies

    @cached_property
    def of_design(self) -> dict[str, Metric]:
        """Metrics of the lens as designed, by many rays, with one LED after the other."""
        return {name: metric for led in self.leds for name, metric in led.of_design.items()}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the metrics."""
        return tuple(self.of_design)

    @cached_property
    def bounds(self) -> tuple[MetricBound, ...]:
        """Bounds that a part must keep in every state."""
        return tuple(bound for led in self.leds for bound in led.bounds)

    def with_rays(self, rays: int) -> "PartStudy":
        """The study with other ``rays`` for each part; results that do not depend on them are shared."""
        study = PartStudy(replace(self.recipe, rays=rays))
        study.__dict__.update({name: getattr(self, name) for name in _OF_ANY_RAYS})
        for led, other in zip(self.leds, study.leds, strict=True):
            other.__dict__.update({name: getattr(led, name) for name in _OF_ANY_RAYS_BY_LED})
        return study

    def deviations(self, number: int, scales: Scales | None = None) -> list[Deviations]:
        """Deviations of one part, some of them scaled, for the lens of each of its lamps."""
        return [self.draws.deviations(number, scales, lamp) for lamp in range(len(self.lamps))]

    def measure(self, number: int, scales: Scales | None = None) -> Float[np.ndarray, "m 2"]:
        """Metrics of one part, in the order of ``names``, and the standard error of each one's change by its errors."""
        deviations = self.deviations(number, scales)
        return np.concatenate([led.measure(deviations) for led in self.leds])

    def noise_in_common(self, parts: int) -> Float[np.ndarray, " m"]:
        """Common share of the ray noise's variance in the changes of parts, for each metric, by the first parts.

        Parts have the same rays, and the noise of a change has two causes: that of the lens as designed, which is in
        every change, and that of the part, alike in others as far as they are alike. With nothing in common the noise
        of the mean over n parts would be 1/n.
        """
        noise = in_parallel_map(lambda number: self._noise(self.deviations(number)), range(parts))
        return np.array([_in_common(np.stack(rows)) for rows in zip(*noise, strict=True)])

    def _noise(self, deviations: list[Deviations]) -> list[Float[np.ndarray, " r"]]:
        return [row for led in self.leds for row in led.noise(deviations)]

    def excess(self, values: Float[np.ndarray, "*n m"]) -> Float[np.ndarray, "*n b"]:
        """Distance of the metrics from each bound, positive on its wrong side."""
        columns = [self.names.index(bound.metric) for bound in self.bounds]
        signs = np.array([1.0 if bound.sense == "<=" else -1.0 for bound in self.bounds])
        limits = np.array([bound.bound for bound in self.bounds])
        return np.asarray(signs * (values[..., columns] - limits))


@dataclass(frozen=True, eq=False)
class LedStudy:
    """Parts of a ``study`` in one state of the ``lens``, named ``led`` if there are several."""

    study: PartStudy
    lens: Lens
    led: str = ""

    @property
    def spec(self) -> Spec:
        """The spec of the state."""
        return self.lens.spec

    @cached_property
    def receivers(self) -> tuple[PosedReceiver, ...]:
        """Receivers of the state."""
        return receivers_of(self.spec, self.spec.evaluate.pixels)

    @cached_property
    def kinds(self) -> tuple[LensOnBoard, ...]:
        """The lens of each kind at work in the state."""
        return tuple(replace(kind, nominal=kind.nominal.at_work(self.spec)) for kind in self.study.kinds)

    @cached_property
    def _source(self) -> Source:
        coloured = judged_colour(self.spec) is not None
        facets = self.lens.media.scattering
        return build_source(self.spec.source, self.lens.dispersion, coloured=coloured, facets=facets)

    @cached_property
    def limits(self) -> tuple[LightLimit, ...]:
        """Limits of the spec, as an evaluation judges them."""
        return self._limits_by(None)

    def _limits_by(self, views: Sequence[LimitView] | None) -> tuple[LightLimit, ...]:
        return light_limits(self.spec, self.receivers, self._efficacy, self._source.flux_w, views)

    @cached_property
    def _efficacy(self) -> Efficacy:
        return efficacy_of(self._source, self.spec.source, photons=self.spec.counts_photons)

    @cached_property
    def designed_pictures(self) -> list[list[list[Channels]]]:
        """Pictures of one lamp of each kind as designed, by many rays, if several are drawn apart; else empty."""
        if self.study.lamps.is_single:
            return []
        judging = held_back(self._source)
        recipe = self.study.recipe
        colour = judged_colour(self.spec)
        return [
            designed_pictures(kind.nominal, judging, kind.boards, recipe.designed_rays, recipe.seed, colour)
            for kind in self.kinds
        ]

    @cached_property
    def light(self) -> PartLight:
        """Receivers, limits and rays."""
        study = self.study
        recipe = self.study.recipe
        held = ReplicateRays.of(held_back(self._source), recipe.rays, recipe.seed)
        coarse = self._limits_by(limit_views(self.spec, coarse=True))
        light = PartLight(self.spec, self.kinds[0].nominal, self.receivers, coarse, held)
        if study.lamps.is_single:
            return light
        receivers = tuple(board.receiver for board in study.boards)
        return BoardLight.of(light, receivers, self.kinds, self.designed_pictures)

    @cached_property
    def designed(self) -> MeasuredPart:
        """The lens as designed, by the rays of the parts."""
        return self.light.measured(self.light.received(None))

    @cached_property
    def designed_light(self) -> Light:
        """The light of the lens as designed, by many rays."""
        lens = self.lens
        spec = self.spec
        recipe = self.study.recipe
        preset = preset_of(lens.accuracy)
        judging = held_back(self._source)
        lumens = self._efficacy.lumens
        return evaluate_traced(
            TracedLens.of(lens, preset.evaluate_nodes_per_sigma),
            spec,
            judging,
            recipe.designed_rays,
            recipe.seed,
            limits=self.limits,
            by_intensities=tuple(limits_by_intensities(lens, judging, preset, lumens, rays=None, seed=recipe.seed)),
            bounds_by=self._source,
            colour=judged_colour(spec),
        )

    @property
    def prefix(self) -> str:
        """Prefix of the names of its metrics: the state, if there are several."""
        return f"{self.led}: " if self.led else ""

    @cached_property
    def of_design(self) -> dict[str, Metric]:
        """Metrics of the lens as designed, by many rays: of the first receiver, of others by name, of limits."""
        *receivers, _ = self._changes(self.designed)
        metrics: dict[str, Metric] = {}
        for prefix, receiver, light in zip(self._prefixes, receivers, self.designed_light.receivers, strict=True):
            metrics |= {f"{prefix}{name}": getattr(light, name) or Metric(value=0.0) for name in receiver}
        return metrics | dict(
            zip(self._limit_names, (limit.metric for limit in self.designed_light.limits), strict=True)
        )

    @property
    def _prefixes(self) -> list[str]:
        _, *further = self.designed_light.receivers
        return [self.prefix, *(f"{self.prefix}{light.name}: " for light in further)]

    @property
    def _limit_names(self) -> list[str]:
        judged = self.designed_light.limits
        names = list[str]()
        plain = [self._plain(number, limit) for number, limit in enumerate(judged)]
        sides = [f"{name} ({_SIDES[limit.sense]})" for name, limit in zip(plain, judged, strict=True)]
        for number, (name, side) in enumerate(zip(plain, sides, strict=True)):
            alike = sides[:number].count(side)  # limits may share their name
            label = side if plain.count(name) > 1 else name
            names.append(f"{self.prefix}{label} {alike + 1}" if alike else f"{self.prefix}{label}")
        return names

    def _plain(self, number: int, limit: Fact) -> str:
        """Name and quantity of a limit; those of the colour are the same on each of several receivers."""
        several = number >= len(self.limits) and len(self.receivers) > 1
        return f"{limit.place}: {limit.label}: {limit.note}" if several else f"{limit.label}: {limit.note}"

    @cached_property
    def bounds(self) -> tuple[MetricBound, ...]:
        """Bounds of a part: the limits of the spec or, without any, those of the verdict on the light."""
        light = self.designed_light
        if not light.limits:
            return tuple(
                MetricBound(metric=f"{prefix}{name}", sense=sense, bound=bound, unit="")
                for prefix, receiver in zip(self._prefixes, light.receivers, strict=True)
                for name, sense, bound in limits_in(light, receiver, self.lens)
            )
        powers = chain((limit.quantity.flux_power for limit in self.limits), repeat(0.0))
        return tuple(
            MetricBound(metric=name, sense=limit.sense, bound=limit.bound, unit=limit.unit, flux_power=power)
            for name, limit, power in zip(self._limit_names, light.limits, powers, strict=False)
        )

    def limit_changes(self, part: MeasuredPart) -> Iterator[LimitChange]:
        """The deciding value of each limit of the spec in ``part``, and its change from the lens as designed."""
        if not part.limits:
            return
        judged = zip(self._limit_names, self.designed_light.limits, part.limits, strict=True)
        for (name, limit, reading), change in zip(judged, part.limit_changes(self.designed), strict=True):
            value = Metric(value=float(reading[0]), unit=limit.metric.unit)
            yield LimitChange(name=name, value=value, change=change.changed(unit=value.unit))

    def made(self, deviations: Sequence[Deviations]) -> tuple[MadePart, ...]:
        """The lenses of a part with these deviations, one for each lamp; those of a plate are about its middle."""
        if self.spec.plate is not None:
            deviations = [
                in_plate(deviation, lamp) for deviation, lamp in zip(deviations, self.study.lamps.lamps, strict=True)
            ]
        makers = {number: kind.maker for kind in self.kinds for number in kind.numbers}
        return tuple(makers[number].part(deviation).in_state(self.spec) for number, deviation in enumerate(deviations))

    def measure(self, deviations: Sequence[Deviations]) -> Float[np.ndarray, "m 2"]:
        """Metrics of a part, in the order of ``of_design``, and the standard error of the change of each."""
        part = self.light.measured(self.light.received(self.made(deviations)))
        changes = [change for group in self._changes(part) for change in group.values()]
        designed = [metric.value for metric in self.of_design.values()]
        errors = [change.standard_error or 0.0 for change in changes]
        return np.array([[value + change.value for value, change in zip(designed, changes, strict=True)], errors]).T

    def noise(self, deviations: Sequence[Deviations]) -> list[Float[np.ndarray, " r"]]:
        """Noise of every change by replicate, in the order of ``of_design``, up to a factor."""
        part = self.light.measured(self.light.received(self.made(deviations)))
        pairs = zip(part.noise, self.designed.noise, strict=True)
        return [of_part - of_designed for of_part, of_designed in pairs]

    def _changes(self, part: MeasuredPart) -> list[dict[str, Metric]]:
        """Changes from the lens as designed; for a luminance relative ones, as views are coarse."""
        changes = part.change_from(self.designed, self.designed_light.receivers)
        for number, (limit, light) in enumerate(zip(self.limits, self.designed_light.limits, strict=False)):
            seen = self.designed.limits[number][0]
            if limit.quantity.of_view and seen > 0.0:
                changes[-1][str(number)] = scaled(changes[-1][str(number)], light.value / seen, light.unit)
        return changes


_MOST_NUMBERS = 2**27  # 1 GiB


def _in_common(noise: Float[np.ndarray, "n r"]) -> float:
    """Share of the variance over the replicates that all of n parts have in common."""
    count = len(noise)
    whole = noise.var(axis=1).mean() if noise.size else 0.0
    if not whole > 0.0:
        return 0.0
    of_mean = noise.mean(axis=0).var() / whole
    return float(np.clip((count * of_mean - 1.0) / (count - 1.0), 0.0, 1.0))
