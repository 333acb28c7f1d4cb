"""Parts of one lens, measured one by one by the same rays, from a small recipe that has everything a worker needs.

The metrics of a part depend on the recipe, its number and its scales alone, and so are the same bits wherever and
whenever they are computed.

Parts share their rays with the lens as designed, so that most of the ray noise cancels in the change from it. A metric
of a part is that of the lens as designed, by many rays, plus this change.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.wall import thinnest_of
from lensforge.errors import InputError
from lensforge.light.evaluation import evaluate_traced
from lensforge.light.evaluation_result import Light
from lensforge.light.judged_limits import values_left_out
from lensforge.light.metrics import Images, jackknife_error
from lensforge.light.receiver_light import ReceiverLight, bounds_on
from lensforge.light.simulation import REPLICATES, ReplicateMetrics, TracedLens, bundles, lit_mask, mean_share
from lensforge.light.table_trace import trace_tables
from lensforge.made.tolerance_result import MetricBound
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.results import Metric
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lens import Lens
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.made_part import MadePart, PartMaker
from lensforge.scene.perturbations import Draws
from lensforge.scene.pixel_grid import bin_replicates, gaussian3
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import DrawnTarget, drawn_target, uniform_region
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.measured_rays import held_back
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS
from lensforge.spec.tolerances_section import Factor, factor_name, factors_of
from lensforge.surfaces.srbf import fibonacci_hemisphere

_COLUMNS = 32  # into which rays are sorted


@dataclass(frozen=True, eq=False)
class HeldLight:
    """Rays of all replicates in one bundle, and the number of the replicate of each."""

    rays: RayBundle
    replicate: Int[np.ndarray, " n"]
    replicates: int
    emitted_w: float

    @staticmethod
    def of(source: Source, rays: int, seed: int) -> "HeldLight":
        """The rays by which an evaluation of so many ``rays`` with ``seed`` simulates."""
        count = min(REPLICATES, rays, source.ray_count or rays)
        parts, numbers = [], []
        for replicate, share, bundle in bundles(source, rays, count, seed):
            parts.append(replace(bundle, flux=bundle.flux * share))
            numbers.append(np.full(len(bundle), replicate))
        joined, replicate_of = RayBundle.joined(parts), np.concatenate(numbers)
        # neighbours use the same part of a table: in order of direction a trace takes a sixth less time
        order = np.lexsort((joined.directions[:, 1], np.floor(_COLUMNS * joined.directions[:, 0])))
        return HeldLight(joined.take(order), replicate_of[order], count, source.flux_w)

    def __len__(self) -> int:
        return len(self.replicate)


@dataclass(frozen=True, eq=False)
class ReceivedImages:
    """Filtered image of flux (W) of every replicate on one receiver; shares of the emitted flux in window and target.

    ``emitted_w``: of this part's source.
    """

    images: Images
    window: Float[np.ndarray, " r"]
    in_target: Float[np.ndarray, " r"]
    emitted_w: float


@dataclass(frozen=True, eq=False)
class PartLight:
    """Simulation of parts of one lens: ``receivers`` of ``spec``, their ``limits``, and the rays of all parts."""

    spec: Spec
    nominal: TracedLens
    receivers: tuple[PosedReceiver, ...]
    limits: tuple[LightLimit, ...]
    held: HeldLight

    def exit_rays(self, part: MadePart | None) -> ExitRays:
        """Rays behind one part; None: behind the lens as designed."""
        nominal, rays = self.nominal, self.held.rays
        if part is None:
            return trace_tables(nominal.tables, nominal.scene, rays)
        scene = replace(nominal.scene, media=part.media(nominal.scene.media), made=part.made)
        return trace_tables(part.tables(nominal.tables), scene, rays)

    def received(self, part: MadePart | None) -> tuple[ReceivedImages, ...]:
        """Light of one part on each receiver; None: of the lens as designed."""
        exits, flux = self.exit_rays(part), 1.0 if part is None else part.flux
        found = []
        for receiver, target in zip(self.receivers, self._targets[0], strict=True):
            landings = receiver.land(exits)
            hits, carried = landings.hits, landings.flux * flux
            held, inside = self.held, (receiver.window.contains(hits), target.contains(hits))
            window, lit = (np.bincount(held.replicate[own], carried[own], minlength=held.replicates) for own in inside)
            images = bin_replicates(hits, carried, receiver.grid, held.replicate, held.replicates)
            emitted_w = flux * held.emitted_w
            smooth = gaussian3(images, self.spec.evaluate.filter_variance)
            found.append(ReceivedImages(smooth, window / emitted_w, lit / emitted_w, emitted_w))
        return tuple(found)

    def measured(self, received: tuple[ReceivedImages, ...]) -> "MeasuredPart":
        """Metrics of one part by its replicates."""
        metrics, shares = [], []
        for found, target, mask in zip(received, *self._targets, strict=True):
            images = found.images
            metrics.append(ReplicateMetrics.of(images, target.light, lit_mask(mask, images), found.window))
            shares.append(found.in_target)
        return MeasuredPart(tuple(metrics), tuple(shares), tuple(self._limits(received)))

    def _limits(self, received: tuple[ReceivedImages, ...]) -> Iterator[Float[np.ndarray, " v"]]:
        """The values that decide on each limit, by all replicates, then with one after the other left out."""
        read = {}
        for receiver, matrix in self._readings.items():  # all limits at once: to read pixels takes longer than to judge
            images, asked = received[receiver].images, [each for each in self.limits if each.receiver == receiver]
            ends = np.cumsum([each.readings.shape[0] for each in asked])[:-1]
            read[receiver] = iter(np.split(matrix @ images.reshape(len(images), -1).T, ends))
        for limit in self.limits:
            yield values_left_out(limit, next(read[limit.receiver]), received[limit.receiver].images)

    @cached_property
    def _readings(self) -> dict[int, sparse.csr_array]:
        """Readings of all limits on each receiver that has some, as one matrix."""
        numbers = dict.fromkeys(limit.receiver for limit in self.limits)
        rows = {each: [limit.readings for limit in self.limits if limit.receiver == each] for each in numbers}
        return {each: sparse.csr_array(sparse.vstack(own)) for each, own in rows.items()}

    @cached_property
    def _targets(self) -> tuple[list[DrawnTarget], list[Bool[np.ndarray, "_ _"] | None]]:
        """Target of each receiver, and its region of uniform light, if any."""
        pairs = list(zip((section.targets for section in self.spec.all_receivers), self.receivers, strict=True))
        targets = [drawn_target(own, receiver) for own, receiver in pairs]
        return targets, [uniform_region(own, each) for own, each in pairs]


@dataclass(frozen=True, eq=False)
class MeasuredPart:
    """Metrics of one part on each receiver, by replicates; shares of flux in the targets; values of its limits."""

    metrics: tuple[ReplicateMetrics, ...]
    shares: tuple[Float[np.ndarray, " r"], ...]
    limits: tuple[Float[np.ndarray, " k"], ...]

    def change_from(
        self, before: "MeasuredPart", rays: int, designed: Sequence[ReceiverLight]
    ) -> list[dict[str, Metric]]:
        """Differences from ``before``, the lens as designed by the same rays: of each receiver, then of the limits.

        ``designed``: the light of that lens by many rays, to which they are to be added.
        """
        found = []
        parts = zip(self.metrics, before.metrics, self.shares, before.shares, strict=True)
        for light, (own, other, share, other_share) in zip(designed, parts, strict=True):
            rsd = None if light.rsd is None else light.rsd.value
            changes = own.change_from(other, rays, designed_rsd=rsd)
            change = {name: value for name, value in changes if value is not None}
            if light.uniformity is not None and "uniformity" in change:
                ratio, moved = light.uniformity.value, change["uniformity"]  # within 0 and 1, however few the rays
                within = min(max(moved.value, -ratio), 1.0 - ratio)
                change["uniformity"] = moved.model_copy(update={"value": within})
            found.append({**change, "share_in_target": mean_share(share - other_share)})
        limits = {}
        for number, (own_limit, other_limit) in enumerate(zip(self.limits, before.limits, strict=True)):
            difference = own_limit - other_limit
            error = jackknife_error(difference[1:]) if len(difference) > 1 else None
            limits[str(number)] = Metric(value=float(difference[0]), standard_error=error)
        return [*found, limits]


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
        """Numbers of every part."""
        return Draws.of(self.factors, self.recipe.parts, self.recipe.seed)

    @cached_property
    def light(self) -> PartLight:
        """Receivers, limits and rays."""
        lens, recipe = self.recipe.lens, self.recipe
        if not lens.spec.all_lamps.alone:
            raise InputError(
                "[lamps]: tolerances are those of one lamp as yet; leave [lamps] out to study the lens alone"
            )
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
            for name, limit in bounds_on(each, transmittance_of(lens.media)).items():
                found.append(MetricBound(metric=f"{prefix}{name}", sense=limit.sense, bound=limit.value, unit=""))
        return tuple(found)

    def with_rays(self, rays: int) -> "PartStudy":
        """Study with other ``rays`` for each part; what does not depend on them is kept."""
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
        return np.asarray(signs * (values[..., columns] - limits))


_DIRECTIONS = 4000
# Farthest that a drawn number lies: a normal one beyond twice its amount in one part of 30,000.
_FARTHEST = {"uniform": 1.0, "truncated": 1.0, "normal": 2.0}
_RMS_TO_PEAK = 3.0
_OF_FACE = ("shift_mm", "gap_mm", "tilt_deg", "form_um", "waviness_um")  # that bring it nearer to another face
_OF_SOURCE = (
    "source_shift_mm", "source_height_mm", "source_tilt_deg", "source_size", "lens_shift_mm", "lens_height_mm",
    "lens_tilt_deg",
)  # fmt: skip


def require_bearable(lens: Lens, factors: Sequence[Factor]) -> None:
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
    nearest = " or ".join(face.name for face in lens.body.cavity)
    of_faces = [factor_name(name, each) for name in lens.spec.lens.names for each in _OF_FACE]
    for factor in factors:
        for names, left, arm, words in (
            (of_faces, wall, reach, f"the faces are {wall:.3g} mm apart at their closest"),
            (_OF_SOURCE, room, size, f"the source is {room:.3g} mm from the {nearest} face at its closest"),
        ):
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
