"""Check of a scene before its search: light that enters the lens, a target that it can light, room for the source.

A search cannot start from darkness, and no search helps against étendue. Both are mistakes of a unit, an axis or a
place that a few thousand rays show at once. Light that targets and limits require stands beside the most that any lens
of the largest radius can bring there.

The search keeps the inner surface outside the cavity's paraboloid, and knows nothing of the source. A source that is
inside it is never touched; the smallest inner surface that the limits allow is the boundary where one is.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf, isfinite, sqrt

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError, remedy
from lensforge.kernels.fate import Fate
from lensforge.light.lens_light import searched_source
from lensforge.light.table_trace import Scene, TracedBundle, trace_tables
from lensforge.optics.fundamental_limits import LEVELS
from lensforge.results.table_names import QUARTER_TURN_RAD
from lensforge.scene.exit_rays import Sensitivities
from lensforge.scene.housing_room import bodies_that_may_be_in_inches, dark_share
from lensforge.scene.intensity_limit import LumensBound
from lensforge.scene.lens import Lens
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.possible_light import BY_PROFILES, LargestShare, PossibleLight, SourceLight
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light
from lensforge.search.start_faces import TargetStroke, start_faces
from lensforge.sources.joined_spectrum import efficacy_of
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.feasible import smallest_cavity_mm
from lensforge.spec.quantities import BodyLight, FluxShare, PlaceLight
from lensforge.spec.source_sections import Placement
from lensforge.spec.spec_section import rounded_up
from lensforge.spec.target_sections import TargetSection
from lensforge.surfaces.bicubic_table import grid_for, tabulate

LEAST_POSSIBLE = 0.5  # of what is required: with less, no search comes near it


@dataclass(frozen=True)
class Requirement:
    """Light that a target or a limit requires, and the most that is ``possible`` there, in ``unit``.

    Of a target and of a limit on a share, the share of the source's flux and its ``bounds``, the unit "%"; a target
    requires all that two faces transmit into its bright part. Of a limit on light, that at its worst place.
    ``radius_mm``: of the smallest lens whose étendue suffices. ``estimated``: by a luminance that is estimated from the
    rays of the source, which is no bound and stops no search. ``beside``: it lies to one side of the axis of a lens of
    revolution. ``by_lumens``: the bound by the lumens of lamps that counts beside étendue, if there is one. ``law``:
    that of light without ``bounds``.
    """

    name: str
    required: float
    possible: float
    unit: str
    radius_mm: float
    estimated: bool
    bounds: LargestShare | None = None
    beside: bool = False
    by_lumens: LumensBound | None = None
    law: str = "étendue"

    @property
    def met(self) -> float:
        """Largest part of what is required."""
        return self.possible / self.required

    @property
    def certain(self) -> bool:
        """False where only the bound of an estimated luminance is too low."""
        bounds = self.bounds
        known = bounds is not None and bounds.certain < LEAST_POSSIBLE * self.required
        return known or not self.estimated

    @property
    def possible_words(self) -> str:
        """The bound in words, or what is an estimate and none."""
        bound = "upper bound"
        if self.estimated:
            bound = "by an estimate of the source's luminance, which is no bound, at most about"
        if self.bounds is None:
            law = self.law if self.by_lumens is None else self.by_lumens.law
            return f"{bound} {self.possible:.3g} {self.unit} ({law})"
        return f"{bound} {self.bounds}"

    @property
    def required_words(self) -> str:
        """The demand in words."""
        return f"{self.required:g} {self.unit}" if self.bounds is None else f"{100.0 * self.required:.3g} %"

    def remedies(self) -> str:
        """Changes that would raise the bound."""
        bounds = self.bounds
        advice = "a smaller source or a larger target"
        if self.by_lumens is not None:
            return self.by_lumens.remedies
        if bounds is None:
            advice = "a smaller or brighter source, or a lower bound"
        elif bounds.by_symmetry < min(bounds.by_etendue, bounds.by_refraction):
            return LEVELS
        elif bounds.by_etendue > bounds.by_refraction and bounds.turned_by == BY_PROFILES:
            return "a target that is longer along y, or another lens.kind: a linear lens turns no light along y"
        elif bounds.by_etendue > bounds.by_refraction:
            return "a larger lens.refractive_index, or a target nearer to the source's axis"
        return f"a larger lens (>= {rounded_up(self.radius_mm)} mm), {advice}" if isfinite(self.radius_mm) else advice


def angles_that_may_be_radians(spec: Spec) -> Iterator[str]:
    """Words on each width of a target in the far field that is so small that it may be in radians."""
    targets = [target for receiver in spec.all_receivers for target in receiver.targets]
    for name, value in (field for target in targets for field in _angular_widths(target)):
        if value < QUARTER_TURN_RAD:
            yield f"{name} = {value:g}: angles are in degrees, {value:g} rad are {np.degrees(value):.4g}"


def _angular_widths(target: TargetSection) -> Iterator[tuple[str, float]]:
    """Widths of a target in the far field by the names of their fields, of an elliptical beam the larger."""
    for name in _ANGULAR_WIDTHS:
        value = getattr(target, name, None)
        if value is not None:
            yield name, max(value) if isinstance(value, tuple) else value


def light_requirements(spec: Spec, source: Source) -> tuple[tuple[Requirement, ...], tuple[Requirement, ...]]:
    """The light required by the targets of each receiver, and by the limits of ``spec``.

    Raises :class:`InputError` for limits whose unit the source does not have.
    """
    light = SourceLight.of(source, spec.media, lens=spec.lens)
    receivers = receivers_of(spec, spec.evaluate.pixels)
    space = spec.lens.exit_space(spec.constraints)
    physics = [PossibleLight(light, receiver, space) for receiver in receivers]
    wanted = [
        target_light(section.targets, receiver) for section, receiver in zip(spec.all_receivers, receivers, strict=True)
    ]
    targets = tuple(_of_target(pattern, bound, spec) for pattern, bound in zip(wanted, physics, strict=True))
    efficacy = efficacy_of(source, spec.source, photons=spec.counts_photons)
    limits = light_limits(spec, receivers, efficacy, source.flux_w)
    limited = [
        _of_view(limit, light, source.flux_w)
        if limit.quantity.of_view
        else _of_limit(limit, physics[limit.receiver], source.flux_w, spec)
        for limit in limits
    ]
    return targets, tuple(requirement for requirement in limited if requirement is not None)


def _of_view(limit: LightLimit, light: SourceLight, flux_w: float) -> Requirement | None:
    """The light that a body is to have at least, or the mean luminance that an eye is to see.

    At most a body has all that two faces transmit, spread evenly; an eye sees the brightest light of the source.
    """
    if limit.sense != ">=":
        return None
    if isinstance(limit.quantity, BodyLight):
        even = 1.0 / float((1.0 / limit.readings.max(axis=1).toarray()).sum())  # light by 1 W
        possible = even * flux_w * light.transmittance
        return Requirement(limit.name, limit.bound, possible, limit.unit, inf, False, law="all that two faces transmit")
    per_watt = 1e-6 * float(limit.readings.max())  # per W/(m² sr)
    possible = per_watt * flux_w * light.brightest
    return Requirement(limit.name, limit.bound, possible, limit.unit, inf, light.curve.estimated)


def _of_target(wanted: Float[np.ndarray, "h w"], physics: PossibleLight, spec: Spec) -> Requirement:
    region = in_target(wanted)
    return _share("target", physics.light.transmittance * float(wanted[region].sum()), region, physics, spec)


def _share(
    name: str, wanted: float, region: Bool[np.ndarray, "h w"], physics: PossibleLight, spec: Spec
) -> Requirement:
    bounds = physics.in_region(region)
    radius_mm = _least_radius_mm(spec, physics, wanted, lambda larger: larger.by_etendue(region))
    beside = physics.beside_axis(region)
    return Requirement(name, wanted, bounds.value, "%", radius_mm, bounds.is_estimate, bounds, beside)


def _of_limit(limit: LightLimit, physics: PossibleLight, flux_w: float, spec: Spec) -> Requirement | None:
    """The share, or the light at the place at which least of it is possible; None for other limits, and upper ones."""
    if limit.sense != ">=" or limit.quantity not in (PlaceLight(), FluxShare()):
        return None
    if limit.quantity == FluxShare():
        region = np.zeros(physics.on_pixels.shape, dtype=bool)
        region.flat[limit.readings.indices] = True
        return _share(limit.name, limit.bound, region, physics, spec)

    def least(larger: PossibleLight) -> float:
        return float(limit.of(larger.on_pixels[None] * flux_w).min())

    most = least(physics)
    estimated = physics.light.curve.estimated
    radius_mm = _least_radius_mm(spec, physics, limit.bound, least)
    if limit.most is not None:
        per_lumen = partial(limit.most.per_lumen, street_deg=spec.photometry.street_side_deg)
        most = min(most, limit.lamp_lm * physics.weighted(per_lumen))
    return Requirement(limit.name, limit.bound, most, limit.unit, radius_mm, estimated, by_lumens=limit.most)


def _least_radius_mm(
    spec: Spec, physics: PossibleLight, wanted: float, most: Callable[[PossibleLight], float]
) -> float:
    """Largest radius (mm) of the smallest lens of which ``most`` is as much as ``wanted``; infinite where of none."""
    limits = spec.constraints

    def suffices(radius_mm: float) -> bool:
        space = spec.lens.exit_space(limits.changed(max_radius_mm=radius_mm))
        return most(replace(physics, space=space)) >= wanted * (1.0 - _ROUNDING)

    low = limits.max_radius_mm
    high = _WIDEST * limits.max_radius_mm
    if suffices(low):
        return low
    if not suffices(high):
        return inf
    while high > _CLOSE * low:
        middle = sqrt(low * high)
        low, high = (low, middle) if suffices(middle) else (middle, high)
    return high


_WIDEST = 1e3  # largest radius that is tried, over the spec's
_CLOSE = 1.0001  # ratio of the ends of a bisection
_ROUNDING = 1e-9
_RAYS = 2**14
_SEED = 0
_NODES_PER_SIGMA = 4.0  # the starting lens is smooth: its entry is right to the noise of the rays
_LEAST_ENTERING = 1e-3  # of the flux; the rest of such a search is noise
_FEW_ENTERING = 0.1  # of the flux, where nothing else is said: a ray file that looks backwards has 0.2 % left
_MOST_PIXELS = 1024  # along a side, in a search
_LEAST_ACROSS = 2.5  # pixels of a stroke; those of the shipped specs have 6.0 or more (curved_screen)
_ANGULAR_WIDTHS = ("fwhm_deg", "width_deg", "height_deg", "diameter_deg", "outer_diameter_deg", "length_deg")
# Shares that a user should know of before waiting for a search.
_WARN_LOST = 0.1
_WARN_POSSIBLE = 0.7
_WARN_DARK = 0.01
_MAIN_CAUSE = 0.1  # of the light that is lost: smaller causes need no remedy of their own
_LOST = {
    Fate.BACKWARD: "goes backward, towards -z",
    Fate.OUTSIDE_CAVITY: "starts outside the cavity or misses its opening",
}


@dataclass(frozen=True)
class SceneCheck:
    """Shares of the source's flux: ``entering`` the starting lens and ``lost`` before it; the light that is required.

    ``targets``: of each receiver. ``limits``: that ask for light. ``mean_direction``: of the flux.
    """

    spec: Spec
    entering: float
    lost: dict[Fate, float]
    targets: tuple[Requirement, ...]
    limits: tuple[Requirement, ...]
    mean_direction: tuple[float, float, float]

    @staticmethod
    def of(spec: Spec, source: Source, start: Lens | None = None) -> "SceneCheck":
        """Trace some rays of ``source`` into the starting lens: that of ``spec``, or ``start``."""
        rays = source.sample(min(_RAYS, source.ray_count or _RAYS), _SEED)
        by_fate = _shares_by_fate(spec, rays, start)
        lost = {fate: by_fate.pop(fate) for fate in _LOST}
        x, y, z = (rays.flux @ rays.directions / rays.flux.sum()).tolist()
        return SceneCheck(spec, sum(by_fate.values()), lost, *light_requirements(spec, source), (x, y, z))

    def require_light(self, *, force: bool = False) -> None:
        """Raise :class:`InputError` where no light enters the lens, or, unless ``force``, less than a tenth of it.

        Likewise where less than half of what a target requires can reach it; an estimated luminance refuses nothing.
        """
        least = _LEAST_ENTERING if force else _FEW_ENTERING
        if self.entering < least:
            anyway = "" if force else "; or design it all the same: --force, in a script force=True"
            raise InputError(f"source: {self._entry()}; at least {_percent(least)} must enter{anyway}")
        for field, light in self._required():
            if light.met < LEAST_POSSIBLE and light.certain and not force:
                lossy = self.entering < LEAST_POSSIBLE  # then the source is to blame, not lens or target
                tries = (f"try {light.remedies()}", *angles_that_may_be_radians(self.spec))
                remedy = self._entry() if lossy else "; ".join(tries)
                raise InputError(
                    f"{field}: {light.possible_words} {self._through()}, less than half of the required "
                    f"{light.required_words}; {remedy}; or design it all the same: --force, in a script force=True"
                )

    def warnings(self) -> tuple[str, ...]:
        """One line for each matter that no search can mend."""
        lines = []
        if 1.0 - self.entering > _WARN_LOST:
            lines.append(self._entry())
        for field, light in self._required():
            if light.met < _WARN_POSSIBLE:
                lines.append(f"{field}: {light.possible_words} {self._through()}; try {light.remedies()}")
            elif light.beside:
                lines.append(f"{field}: off the axis; try {LEVELS}")
        stroke = TargetStroke.of(self.spec)
        lines = lines or list(self._blur(stroke))
        return (
            *lines,
            *(f"target: {warning}" for warning in angles_that_may_be_radians(self.spec) if lines),
            *self._raster(stroke),
            *self._in_shadow(),
            *self._walls(),
            *bodies_that_may_be_in_inches(self.spec),
        )

    def _in_shadow(self) -> Iterator[str]:
        """A line where bodies of the scene keep light from a target, whatever the lens; of one lamp."""
        if not (self.spec.scene and self.spec.all_lamps.is_single) or self.spec.media.walls:
            return
        receivers = receivers_of(self.spec, self.spec.optimise.pixels)
        for receiver, section, (field, _) in zip(receivers, self.spec.all_receivers, self._required(), strict=False):
            wanted = target_light(section.targets, receiver)
            corners = receiver.corners()
            places = 0.25 * (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1])
            share = dark_share(self.spec, places.reshape(-1, 3), wanted.ravel(), receiver.is_far)
            if share > _WARN_DARK:
                yield (
                    f"{field}: bodies of the scene keep {_percent(share)} of its light from it, whatever the lens; "
                    "move the bodies, or make the target smaller"
                )

    def _walls(self) -> Iterator[str]:
        """A line if light crosses bodies of the scene, which the search does not follow."""
        names = [repr(body.name) for body in self.spec.scene if body.surface == "clear"]
        if names:
            yield (
                f"scene: the search takes {', '.join(names)} for air; evaluation and proof count what they refract and "
                "lose"
            )

    def _blur(self, stroke: TargetStroke) -> Iterator[str]:
        """A line where the image of the LED is wider than any stroke of the target."""
        wide = stroke.width_rad
        image = image_rad(self.spec)
        if image > wide:
            larger_mm = rounded_up(image * self.spec.constraints.max_radius_mm / wide)
            yield (
                f"target: no part of it is wider than {np.degrees(wide):.3g}° as seen from the lens, and the LED's "
                f"image of up to {np.degrees(image):.3g}° blurs it; try a larger lens (>= {larger_mm} mm), a smaller "
                "source or a wider target"
            )

    def _raster(self, stroke: TargetStroke) -> Iterator[str]:
        """A line where the pixels of the search are too wide for the target."""
        across = stroke.pixels
        settings = self.spec.optimise
        if across < _LEAST_ACROSS:
            enough = ceil(_LEAST_ACROSS / across * settings.pixels)
            more = (
                f"optimise.pixels = {enough} and evaluate.pixels = {2 * enough}, or " if enough <= _MOST_PIXELS else ""
            )
            yield (
                f"target: no part of it is wider than {across:.2g} pixels of the search, which blur it; try {more}a "
                "smaller receiver"
            )

    def _required(self) -> Iterator[tuple[str, Requirement]]:
        """Targets and limits by the names of their fields."""
        for receiver, target in zip(self.spec.all_receivers, self.targets, strict=True):
            yield "target" if self.spec.target is not None else f"receivers: target on {receiver.name}", target
        for limit in self.limits:
            yield f"limits: {limit.name}", limit

    def _entry(self) -> str:
        """Share of the light that enters the starting lens, the fate of the rest, and changes to try, in words."""
        causes = ", ".join(f"{_percent(share)} {_LOST[fate]}" for fate, share in self.lost.items() if share > 0.0)
        entering = f"{_percent(self.entering)} of the light enters the starting lens"
        return f"{entering}: {causes}; try {', '.join(self._remedies())}"

    def _remedies(self) -> Iterator[str]:
        """Fields that mend the main causes, the largest first."""
        fields = type(self.spec.source).model_fields
        main = _MAIN_CAUSE * (1.0 - self.entering)
        for fate, share in sorted(self.lost.items(), key=lambda item: -item[1]):
            if share > main and fate == Fate.BACKWARD:
                mean = ", ".join(f"{component:.2f}" for component in self.mean_direction)
                turn = [f"source.{name}" for name in ("axis", "tilt_deg") if name in fields]
                yield f"{' or '.join(turn)} (the mean direction is ({mean}) in the lens, it should be near +z)"
            elif share > main:
                places = [f"source.{name}" for name in ("scale", "origin", "position_mm") if name in fields]
                name = self.spec.lens.names[0]
                cavity = f"lens.{name}.offset_mm" if self.spec.lens.fixed[name] is None else f"lens.{name}.fixed"
                yield ", ".join([*places, f"or a larger {cavity}"])

    def _through(self) -> str:
        largest = f"through a lens of constraints.max_radius_mm = {self.spec.constraints.max_radius_mm:g}"
        if self.spec.target is not None and self.spec.target.distance_mm is not None:
            return f"{largest} at target.distance_mm = {self.spec.target.distance_mm:g}"
        return largest


def image_rad(spec: Spec) -> float:
    """Largest width (rad) of the image of the LED, as seen from the lens."""
    return 2.0 * max(source.extent_mm or 0.0 for source in spec.each_source) / spec.constraints.max_radius_mm


def _shares_by_fate(spec: Spec, rays: RayBundle, start: Lens | None) -> dict[Fate, float]:
    surfaces = (start_faces(spec) if start is None else start.surfaces).values()
    with remedy(f"take {spec.lens.coarser}"):
        grid = grid_for(min(surface.detail_rad for surface in surfaces), _NODES_PER_SIGMA)
    scene = Scene.of_lens(spec.lens, spec.lens.media, grid)
    exits = trace_tables([tabulate(grid, surface) for surface in surfaces], scene, rays)
    by_fate = np.bincount(exits.fates, rays.flux, minlength=len(Fate)) / rays.flux.sum()
    return {fate: float(by_fate[fate]) for fate in Fate}


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def compile_search_kernels(spec: Spec) -> None:
    """Compile the trace of a search and its adjoint, by one ray: where that is done already, load them."""
    surfaces = start_faces(spec).values()
    with remedy(f"take {spec.lens.coarser}"):
        grid = grid_for(min(surface.detail_rad for surface in surfaces), _NODES_PER_SIGMA)
    scene = Scene.of_lens(spec.lens, spec.lens.media, grid, fresnel=spec.optimise.fresnel, single=True)
    rays = searched_source(spec).sample(1, _SEED)
    nothing = np.zeros((1, 3))
    traced = TracedBundle.of([tabulate(grid, surface) for surface in surfaces], scene, rays)
    traced.gradients(Sensitivities(nothing, nothing), nothing[:, 0].copy(), nothing[:, 0].copy())


_SLACK = 1e-6  # relative: rounding of a corner that lies on the boundary


def source_clearance_warnings(spec: Spec, source: Source) -> tuple[str, ...]:
    """Warn where the limits let the inner surface touch ``source``, the one of ``spec``.

    Raises :class:`InputError` for a source that was placed there, off the axis or above z = 0, and for one that reaches
    beyond the largest lens: its place or the limits are wrong. Nothing is said of a ray set: its rays need not start on
    the source.
    """
    if isinstance(spec.source, Placement):
        return ()
    above = _above_plane(source.outline())
    distance = np.linalg.norm(above, axis=1)
    polar = np.arctan2(np.hypot(above[:, 0], above[:, 1]), above[:, 2])
    smallest = smallest_cavity_mm(spec.lens, spec.constraints)
    room = np.interp(polar, np.linspace(0.0, 0.5 * np.pi, len(smallest)), smallest) - distance
    if not len(room) or room.min() >= -_SLACK * distance.max():
        return ()
    x, y, z = above[room.argmin()]
    reaches = f"source: it reaches ({x:.4g}, {y:.4g}, {z:.4g}) mm"
    limits = spec.constraints
    if distance.max() >= limits.max_radius_mm:
        raise InputError(
            f"{reaches}, beyond a lens of constraints.max_radius_mm = {limits.max_radius_mm:g}; correct its size "
            "or place, which are in mm, or raise the limit"
        )
    kept = (
        f"lens.{spec.lens.names[0]}.fixed"
        if spec.lens.fixed[spec.lens.names[0]] is not None
        else f"the paraboloid of constraints.cavity_height_mm = {limits.cavity_height_mm:g} and cavity_radius_mm = "
        f"{limits.cavity_radius_mm:g}"
    )
    problem = (
        f"{reaches}, {np.hypot(x, y):.4g} mm from the axis, outside {kept}; only that is kept clear, and the lens may "
        "touch the source"
    )
    if spec.source.pose.moves:
        raise InputError(f"{problem}; raise the limits, or change source.position_mm or tilt_deg")
    return (f"{problem}; raise the limits",)


def _above_plane(outline_mm: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "m 3"]:
    """Corners of the part of a polygon with z >= 0, those where its edges cross the plane z = 0 included."""
    corners = [corner for corner in outline_mm if corner[2] >= 0.0]
    for corner, next_corner in zip(outline_mm, np.roll(outline_mm, -1, axis=0), strict=True):
        if corner[2] * next_corner[2] < 0.0:
            corners.append(corner + corner[2] / (corner[2] - next_corner[2]) * (next_corner - corner))
    return np.array(corners).reshape(-1, 3)
