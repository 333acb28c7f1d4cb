"""Costs of the limits that tools set to a lens: short searches from its end on, with these limits and without.

A search that ends has seldom converged, so that further steps gain by themselves: what limits cost is the difference of
two lenses after the same steps with the same rays, as few as a draft's, whose noise both share. It is less than whole
searches would differ by, as 20 to 40 steps gain most of what there is, but not all. From a lens that has nearly
converged the usual steps lead away: where they gain nothing, shorter ones are tried. Where the first search, without
all limits, gains less than is told, it is the only one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean

from lensforge.light.evaluation_result import Light
from lensforge.light.lens_light import evaluate, searched_source
from lensforge.results.fact import Change
from lensforge.scene.lens import Lens
from lensforge.search.design_result import CURVATURE, DRAFT, Design, ToolCost, limits_of
from lensforge.spec import Spec
from lensforge.spec.accuracy import preset_of
from lensforge.spec.processes import LEVEL_DEG

_LEAST_STEPS = 20
_MOST_STEPS = 40
_OF_SEARCH = 20  # steps of the whole search for one here
_RATES = (1.0, 0.25)  # of the usual length of a step
_RAYS_OF_STEP = 2**14
_RAYS = 131072  # the same for all: a difference has far less noise than a figure
_AT_LIMIT = 10.0  # of the margin with which a search ends inside a limit: 0.3 degrees, or 3 % of a radius
_FAR_TILT_DEG = 20.0  # beyond what the axis tilts, to tell what that costs
_LITTLE_DRAFT_DEG = 0.5


def tool_costs(design: Design) -> tuple[ToolCost, ...]:
    """Costs of the limits that tools set to the lens of ``design``: of all, and of each where they matter.

    Empty for a lens whose faces are at none of these limits, and where a short search without them gains too little.
    """
    lens = design.lens
    kinds = holding_tools(design)
    if not kinds:
        return ()
    steps = min(max(design.steps // _OF_SEARCH, _LEAST_STEPS), _MOST_STEPS)
    unlimited = lens.spec.made_by("none")
    for further in (_Further(lens, steps, rate) for rate in _RATES):
        if (unlimited_lens := further.lens_by(unlimited)) is not None:
            free = _light(unlimited_lens)
            return tuple(_costs(further, free, kinds)) if _whole(_light(lens), free).matters else ()
    return ()


def _costs(further: "_Further", free: Light, kinds: set[str]) -> Iterator[ToolCost]:
    """Cost against the ``free`` light and, where it matters, those against lenses with an easier limit of ``kinds``."""
    spec = further.lens.spec
    held = _light(further.lens_by(spec) or further.lens)
    whole = _whole(held, free)
    yield whole
    for limit, change in _easier(spec, kinds) if whole.matters else ():
        easier = further.lens_by(spec.replace({change.field: float(change.value)}))
        yield _cost(limit, change, held, _light(easier or further.lens))


def holding_tools(design: Design) -> set[str]:
    """Kinds of the limits of tools at which a face of the lens is."""
    spec = design.lens.spec
    limits = (limit for limit in limits_of(spec) if limit.kind in (CURVATURE, DRAFT) and not limit.is_stated)
    return {limit.kind for limit in limits if design.constraints.at(limit) < _AT_LIMIT * limit.spare}


def _easier(spec: Spec, kinds: set[str]) -> Iterator[tuple[str, Change]]:
    """Limits of ``kinds`` in words, and a change of the spec that makes each easier."""
    shop = spec.manufacture
    cuts = {spec.cutting(name) for name in spec.lens.names}
    if CURVATURE in kinds and "milled" in cuts:
        yield f"ball of {shop.cutter_radius_mm:g} mm", _half("cutter_radius_mm", shop.cutter_radius_mm)
    if CURVATURE in kinds and "turned" in cuts:
        yield f"nose of {shop.nose_radius_mm:g} mm", _half("nose_radius_mm", shop.nose_radius_mm)
    if DRAFT not in kinds:
        return
    if shop.cuts == "lens":
        if shop.max_tilt_deg < LEVEL_DEG:
            farther = min(shop.max_tilt_deg + _FAR_TILT_DEG, LEVEL_DEG)
            yield f"tilt of {shop.max_tilt_deg:g} deg", Change("manufacture.max_tilt_deg", f"{farther:g}")
        return
    for name in spec.lens.names:
        asked = spec.asked_draft_deg(name)
        if asked is not None and asked > _LITTLE_DRAFT_DEG and spec.lens.role(name).follows is None:
            yield f"draft of the {name} face", Change(f"lens.{name}.draft_deg", f"{_LITTLE_DRAFT_DEG:g}")


def _half(field: str, radius_mm: float) -> Change:
    return Change(f"manufacture.{field}", f"{0.5 * radius_mm:g}")


@dataclass(frozen=True)
class _Further:
    """Short searches of ``steps`` from ``lens`` on, ``rate`` times as long as usual."""

    lens: Lens
    steps: int
    rate: float

    def lens_by(self, spec: Spec) -> Lens | None:
        """The lens that a search by ``spec`` finds; None if it is no better than the one from which it begins."""
        from lensforge.search.optimiser import search  # torch, which no run without such limits needs here

        coarser = len(spec.lens.shape_levels) - 1
        short = spec.replace({"optimise.steps_per_level": [1] * coarser + [self.steps], "optimise.seconds": None})
        preset = preset_of(self.lens.accuracy)
        rays = min(preset.design_rays, _RAYS_OF_STEP)
        effort = {"learning_rate": self.rate * preset.effort.learning_rate}
        design = search(
            short,
            searched_source(short),
            accuracy=preset.replace("further_steps", design_rays=rays, effort=effort),
            seed=self.lens.seed,
            start=self.lens,
        )
        return None if design.kept_start else design.lens


def _whole(held: Light, free: Light) -> ToolCost:
    return _cost("tools", Change("manufacture.process", '"none"'), held, free)


def _light(lens: Lens) -> Light:
    # To measure the error of the tables, which both lenses share, would take longer than these rays.
    return evaluate(lens, rays=_RAYS, accuracy=preset_of(lens.accuracy).replace("tool_costs", table_error=False))


def _cost(limit: str, change: Change, held: Light, free: Light) -> ToolCost:
    errors = [None if light.nmse is None else _mean(light, "nmse") for light in (held, free)]
    return ToolCost(
        limit=limit,
        instead=str(change),
        efficiency=_mean(free, "efficiency") - _mean(held, "efficiency"),
        nmse=errors[0],
        nmse_without=errors[1],
    )


def _mean(light: Light, metric: str) -> float:
    """Mean of a ``metric`` over the states of the lens."""
    return fmean(getattr(case.result, metric).value for case in light.cases())
