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
from lensforge.receivers.build import receivers_of
from lensforge.receivers.possible import LargestShare, largest_share
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import AnyReceiver, Spec
from lensforge.surfaces.conic import sphere
from lensforge.surfaces.spline import grid_for, tabulate
from lensforge.surfaces.surface import Surface
from lensforge.targets.pattern import target_light
from lensforge.targets.region import in_target
from lensforge.tracing.tables import Scene, trace_tables

_RAYS, _SEED = 2**14, 0
_NODES_PER_SIGMA = 4.0  # the starting lens is smooth: its entry is right to the noise of the rays
_LEAST_ENTERING = 1e-3  # of the flux; the rest of such a search is noise
_LEAST_POSSIBLE = 0.01  # of the flux: less of it in the target is no design but a wrong unit
_WARN_LOST, _WARN_POSSIBLE = 0.1, 0.7  # shares of the flux that a user should know of before waiting for a search
_MAIN_CAUSE = 0.1  # of the light that is lost: smaller causes need no remedy of their own
_LOST = {
    Fate.BACKWARD: "goes backward, towards -z",
    Fate.OUTSIDE_CAVITY: "starts outside the cavity or misses its opening",
}


@dataclass(frozen=True)
class SceneCheck:
    """Shares of the source's flux: ``entering`` the starting lens, ``lost`` before it, ``possible`` in the targets.

    ``possible``: at most, in those of each receiver, by :func:`~lensforge.receivers.possible.largest_share`.
    ``mean_direction``: of the flux.
    """

    spec: Spec
    entering: float
    lost: dict[Fate, float]
    possible: tuple[LargestShare, ...]
    mean_direction: tuple[float, float, float]

    @staticmethod
    def of(spec: Spec, source: Source, start: Lens | None = None) -> "SceneCheck":
        """Trace some rays of ``source`` into the starting lens: that of ``spec``, or ``start``."""
        rays = source.sample(min(_RAYS, source.ray_count or _RAYS), _SEED)
        by_fate = _shares_by_fate(spec, rays, start)
        lost = {fate: by_fate.pop(fate) for fate in _LOST}
        x, y, z = (rays.flux @ rays.directions / rays.flux.sum()).tolist()
        return SceneCheck(spec, sum(by_fate.values()), lost, _possible_shares(spec, rays), (x, y, z))

    def require_light(self) -> None:
        """Raise :class:`InputError` where no light enters the lens, or none can reach the target."""
        if self.entering < _LEAST_ENTERING:
            raise InputError(
                f"source: {_percent(self.entering)} of the light enters the starting lens, at least "
                f"{_percent(_LEAST_ENTERING)} must: {self._causes()}; try {', '.join(self._remedies())}"
            )
        for receiver, possible in zip(self.spec.all_receivers, self.possible, strict=True):
            if possible.value < _LEAST_POSSIBLE:
                raise InputError(
                    f"{self._named(receiver)}: {possible} of the light can reach it {self._through(receiver)}, at "
                    f"least {_percent(_LEAST_POSSIBLE)} must; check the units of {self._distance()}, of the target's "
                    "size and of the source's, or raise constraints.max_radius_mm or lens.refractive_index"
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
        for receiver, possible in zip(self.spec.all_receivers, self.possible, strict=True):
            if possible.value < _WARN_POSSIBLE:
                name = "the target" if self.spec.target is not None else f"the target on {receiver.name}"
                yield (
                    f"{possible} of the light can reach {name} {self._through(receiver)}; try a larger "
                    "constraints.max_radius_mm, a smaller source or a larger target"
                )

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

    def _named(self, receiver: AnyReceiver) -> str:
        return "target" if self.spec.target is not None else f"receivers: target on {receiver.name}"

    def _distance(self) -> str:
        return "its distance" if self.spec.target is None else "target.distance_mm"

    def _through(self, receiver: AnyReceiver) -> str:
        largest = f"through a lens of constraints.max_radius_mm = {self.spec.constraints.max_radius_mm:g}"
        if self.spec.target is not None and self.spec.target.distance_mm is not None:
            return f"{largest} at target.distance_mm = {self.spec.target.distance_mm:g}"
        return f"{largest} {receiver.place}"


def _shares_by_fate(spec: Spec, rays: RayBundle, start: Lens | None) -> dict[Fate, float]:
    """Shares of the flux by fate in the starting lens."""
    inner, outer = _starting_surfaces(spec) if start is None else (start.inner, start.outer)
    grid = grid_for(min(inner.detail_rad, outer.detail_rad), _NODES_PER_SIGMA)
    inner_table, outer_table = (torch.from_numpy(tabulate(grid, surface)) for surface in (inner, outer))
    exits = trace_tables(inner_table, outer_table, Scene(spec.lens.refractive_index, grid), rays)
    by_fate = np.bincount(exits.fates.numpy(), rays.flux, minlength=len(Fate)) / rays.flux.sum()
    return {fate: float(by_fate[fate]) for fate in Fate}


def _starting_surfaces(spec: Spec) -> tuple[Surface, Surface]:
    inner, outer = (sphere(radius_mm) for radius_mm in spec.lens.start_mm)
    fixed_inner, fixed_outer = spec.lens.fixed
    return fixed_inner or inner, fixed_outer or outer


def _possible_shares(spec: Spec, rays: RayBundle) -> tuple[LargestShare, ...]:
    """The largest share in the targets of each receiver."""
    largest_mm, index = spec.constraints.max_radius_mm, spec.lens.refractive_index
    return tuple(
        largest_share(rays, in_target(target_light(section.targets, receiver)), receiver, largest_mm, index)
        for section, receiver in zip(spec.all_receivers, receivers_of(spec, spec.evaluate.pixels), strict=True)
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
