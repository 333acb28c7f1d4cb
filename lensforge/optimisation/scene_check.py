"""Check of a scene before its search: light that enters the starting lens, and a target that a lens can light at all.

A search cannot start from darkness, and no search helps against étendue. Both are mistakes of a unit, an axis or a
place that a few thousand rays show at once.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from lensforge.errors import InputError
from lensforge.kernels.fates import Fate
from lensforge.lens import Lens
from lensforge.optimisation.asked_light import LEAST_POSSIBLE, Asked, AskedShare, asked_light
from lensforge.receivers.build import receivers_of
from lensforge.receivers.posed import PosedReceiver
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.receivers import PlaneReceiver
from lensforge.surfaces.conic import sphere
from lensforge.surfaces.spline import grid_for, tabulate
from lensforge.surfaces.surface import Surface
from lensforge.targets.pattern import target_light
from lensforge.tracing.tables import Scene, trace_tables

_RAYS, _SEED = 2**14, 0
_NODES_PER_SIGMA = 4.0  # the starting lens is smooth: its entry is right to the noise of the rays
_LEAST_ENTERING = 1e-3  # of the flux; the rest of such a search is noise
_WARN_LOST, _WARN_POSSIBLE = 0.1, 0.7  # shares that a user should know of before waiting for a search
_STEEP, _PIXELS = 0.7, 64  # a component of an axis along z; pixels along a side
_MAIN_CAUSE = 0.1  # of the light that is lost: smaller causes need no remedy of their own
_LOST = {
    Fate.BACKWARD: "goes backward, towards -z",
    Fate.OUTSIDE_CAVITY: "starts outside the cavity or misses its opening",
}


@dataclass(frozen=True)
class SceneCheck:
    """Shares of the source's flux: ``entering`` the starting lens and ``lost`` before it; the light that is asked for.

    ``targets``: of each receiver. ``limits``: that ask for light. ``mean_direction``: of the flux.
    """

    spec: Spec
    entering: float
    lost: dict[Fate, float]
    targets: tuple[AskedShare, ...]
    limits: tuple[Asked, ...]
    mean_direction: tuple[float, float, float]

    @staticmethod
    def of(spec: Spec, source: Source, start: Lens | None = None) -> "SceneCheck":
        """Trace some rays of ``source`` into the starting lens: that of ``spec``, or ``start``."""
        rays = source.sample(min(_RAYS, source.ray_count or _RAYS), _SEED)
        by_fate = _shares_by_fate(spec, rays, start)
        lost = {fate: by_fate.pop(fate) for fate in _LOST}
        x, y, z = (rays.flux @ rays.directions / rays.flux.sum()).tolist()
        return SceneCheck(spec, sum(by_fate.values()), lost, *asked_light(spec, source), (x, y, z))

    def require_light(self, *, anyway: bool = False) -> None:
        """Raise :class:`InputError` where no light enters the lens or, unless ``anyway``, less than half can do.

        That is half of what the target asks for. A luminance that is an estimate refuses nothing.
        """
        if self.entering < _LEAST_ENTERING:
            raise InputError(
                f"source: {_percent(self.entering)} of the light enters the starting lens, at least "
                f"{_percent(_LEAST_ENTERING)} must: {self._causes()}; try {', '.join(self._remedies())}"
            )
        for field, asked in self._asked():
            if asked.met < LEAST_POSSIBLE and asked.certain and not anyway:
                raise InputError(
                    f"{field}: {asked.possible_words} {self._through()}, less than half of the {asked.asked_words}: "
                    f"{self._help(asked)}; or design it all the same: --anyway, in a script anyway=True"
                )

    def warnings(self) -> tuple[str, ...]:
        """One line for each matter that no search can mend."""
        return tuple(self._warnings())

    def _warnings(self) -> Iterator[str]:
        if 1.0 - self.entering > _WARN_LOST:
            yield (
                f"{_percent(self.entering)} of the light enters the starting lens: {self._causes()}; "
                f"try {', '.join(self._remedies())}"
            )
        for field, asked in self._asked():
            if asked.met < _WARN_POSSIBLE:
                yield f"{field}: {asked.possible_words} {self._through()}; try {asked.remedies()}"
        for section, receiver in zip(self.spec.all_receivers, receivers_of(self.spec, _PIXELS), strict=True):
            if isinstance(section, PlaneReceiver):
                yield from _of_plane(section, receiver)

    def _asked(self) -> Iterator[tuple[str, Asked]]:
        """Targets and limits by the names of their fields."""
        for receiver, target in zip(self.spec.all_receivers, self.targets, strict=True):
            yield "target" if self.spec.target is not None else f"receivers: target on {receiver.name}", target
        for limit in self.limits:
            yield f"limits: {limit.name}", limit

    def _help(self, asked: Asked) -> str:
        """Changes to try: of the source where most of its light is lost before the lens, else lens or target."""
        if self.entering < LEAST_POSSIBLE:
            return f"{self._causes()}; try {', '.join(self._remedies())}"
        return f"try {asked.remedies()}"

    def _causes(self) -> str:
        return ", ".join(f"{_percent(share)} {_LOST[fate]}" for fate, share in self.lost.items() if share > 0.0)

    def _remedies(self) -> Iterator[str]:
        """Fields that mend the main causes, the largest first."""
        fields, main = type(self.spec.source).model_fields, _MAIN_CAUSE * (1.0 - self.entering)
        for fate, share in sorted(self.lost.items(), key=lambda item: -item[1]):
            if share > main and fate == Fate.BACKWARD:
                mean = ", ".join(f"{each:.2f}" for each in self.mean_direction)
                turn = [f"source.{name}" for name in ("axis", "tilt_deg") if name in fields]
                yield f"{' or '.join(turn)} (the mean direction is ({mean}) in the lens, it should be near +z)"
            elif share > main:
                places = [f"source.{name}" for name in ("scale", "origin", "position_mm") if name in fields]
                cavity = "lens.inner_offset_mm" if self.spec.lens.fixed_inner is None else "lens.fixed_inner"
                yield ", ".join([*places, f"or a larger {cavity}"])

    def _through(self) -> str:
        largest = f"through a lens of constraints.max_radius_mm = {self.spec.constraints.max_radius_mm:g}"
        if self.spec.target is not None and self.spec.target.distance_mm is not None:
            return f"{largest} at target.distance_mm = {self.spec.target.distance_mm:g}"
        return largest


def _of_plane(section: PlaneReceiver, receiver: PosedReceiver) -> Iterator[str]:
    """Lines on a plane that stands steeply, whose axes nobody sees, and on a target behind the plane of the LED."""
    x, y, _ = receiver.pose.axes
    if section.rotation_deg == 0.0 and max(abs(x[2]), abs(y[2])) > _STEEP:
        along = " and ".join(
            f"{name} along ({', '.join(f'{each + 0.0:.2g}' for each in axis.round(6))})"
            for name, axis in (("x", x), ("y", y))
        )
        yield f"receivers: {section.name}: it has {along} in the lens; rotation_deg turns it about its normal"
    wanted = target_light(section.targets, receiver)
    height_mm = receiver.places(*np.meshgrid(receiver.grid.x(), receiver.grid.y()))[..., 2]
    behind = float(wanted[height_mm < 0.0].sum() / wanted.sum())
    if behind > 0.0:
        yield (
            f"receivers: {section.name}: {_percent(behind)} of its target lies behind the LED's plane z = 0, where "
            "a lens sends little light; move or shrink the target"
        )


def _shares_by_fate(spec: Spec, rays: RayBundle, start: Lens | None) -> dict[Fate, float]:
    """Shares of the flux by fate in the starting lens."""
    inner, outer = starting_surfaces(spec) if start is None else (start.inner, start.outer)
    grid = grid_for(min(inner.detail_rad, outer.detail_rad), _NODES_PER_SIGMA)
    inner_table, outer_table = (torch.from_numpy(tabulate(grid, surface)) for surface in (inner, outer))
    exits = trace_tables(inner_table, outer_table, Scene(spec.lens.media, grid), rays)
    by_fate = np.bincount(exits.fates.numpy(), rays.flux, minlength=len(Fate)) / rays.flux.sum()
    return {fate: float(by_fate[fate]) for fate in Fate}


def starting_surfaces(spec: Spec) -> tuple[Surface, Surface]:
    """Inner and outer surface from which a search begins: two spheres, or those that the spec fixes."""
    inner, outer = (sphere(radius_mm) for radius_mm in spec.lens.start_mm)
    fixed_inner, fixed_outer = spec.lens.fixed
    return fixed_inner or inner, fixed_outer or outer


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
