"""The task in words: what emits, what body, which pattern is wanted."""

from lensforge.spec import CrossTarget, FlatTopTarget, Spec, TextTarget


def task(spec: Spec) -> str:
    """Source, lens and target in one line."""
    lens = spec.lens
    body = f"double-freeform lens, {lens.material}, n = {lens.refractive_index:g}"
    return f"{spec.source.title} · {body} · {_target(spec)} at {spec.target.distance_mm:g} mm"


def _target(spec: Spec) -> str:
    target = spec.target
    if isinstance(target, FlatTopTarget):
        return f"square flat top, {2.0 * target.half_width_mm:g} mm wide"
    if isinstance(target, CrossTarget):
        return f"cross, {target.length_mm:g} mm long"
    if isinstance(target, TextTarget):
        return f"“{target.text}”, {target.width_mm:g} mm wide"
    return f"{target.file.name}, {target.width_mm:g} mm wide"
