"""The task in words: what emits, what body, which pattern is wanted, in which unit of light."""

from lensforge.figures.light_unit import LightUnit, light_unit
from lensforge.spec import CrossTarget, FlatTopTarget, Spec, TextTarget
from lensforge.spec.target import ArrayTarget


def task(spec: Spec) -> str:
    """Source, lens and target in one line."""
    lens = spec.lens
    body = f"double-freeform lens, {lens.material}, n = {lens.refractive_index:g}"
    return f"{spec.source.title} · {body} · {_target(spec)} at {spec.target.distance_mm:g} mm"


def unit_of_light(spec: Spec) -> LightUnit:
    """Lux where the spec says how many lumens a watt of its source is, without it W/m^2."""
    return light_unit(spec.source.luminous_efficacy_lm_per_w)


def _target(spec: Spec) -> str:
    target = spec.target
    if isinstance(target, FlatTopTarget):
        return f"square flat top, {2.0 * target.half_width_mm:g} mm wide"
    if isinstance(target, CrossTarget):
        return f"cross, {target.length_mm:g} mm long"
    if isinstance(target, TextTarget):
        return f"“{target.text}”, {target.width_mm:g} mm wide"
    if isinstance(target, ArrayTarget):
        return f"given pattern, {target.width_mm:g} mm wide"
    return f"{target.file.name}, {target.width_mm:g} mm wide"
