"""Numbers that the page and the screen of a sweep must show, by their label, each from the results of its design."""

from shown_numbers import shown, with_error
from wanted_comparison import place_of

_METRICS = ("nmse", "uniformity", "efficiency")
_NAMES = {"nmse": "NMSE"}


def sweep_numbers(sweep, designs):
    """Entries of the page; ``designs``: results by the value of the varied field."""
    scaled = f", in proportion to it {' and '.join(sweep.scale)}" if sweep.scale else ""
    first = next(iter(designs.values())).lens
    words = f"{{}} designs over {sweep.vary}{scaled}; --accuracy {first.accuracy}, seed {{}}."
    yield shown("p", words, len(designs), first.seed)
    for value, results in designs.items():
        yield from _row(sweep, value, results)
        yield from _pictures(f"{sweep.vary.rpartition('.')[2]} = {value:g}", value, results)
    yield shown("Sections / p", "Sections at φ = 0°, all to one scale.")
    yield shown("Sections / footer", f"Written by lensforge {first.version}.")


def _row(sweep, value, results):
    row, light, design = results.spec.name, results.light.first, results.design
    yield shown(f"{row} / {sweep.vary}", "{}", value)
    for field in sweep.scale:
        section, name = field.split(".")
        yield shown(f"{row} / {field}", "{}", getattr(getattr(results.spec, section), name))
    for name in _METRICS:
        if getattr(light, name) is not None:
            yield with_error(f"{row} / {_NAMES.get(name, name)}", getattr(light, name))
    yield shown(f"{row} / largest radius (mm)", "{}", design.max_radius_mm)
    yield shown(f"{row} / height (mm)", "{}", design.height_mm)
    yield shown(f"{row} / steps", "{}", design.steps)
    missed = ", ".join(each.name for _, each in results.criteria() if not each.passed)
    yield shown(f"{row} / criteria", f"missed: {missed}" if missed else "all met")
    yield shown(f"{row} / cutting", results.verdict.cutting)


def _pictures(title, value, results):
    before = title.partition(" = ")[0]
    yield shown(f"Sections / {title} / title", f"{before} = {{}}", value)
    receivers = results.spec.all_receivers
    for section, each in zip(receivers, results.light.receivers, strict=True):
        on = f", {each.name}" if len(receivers) > 1 else ""
        yield shown(f"Light / {title}{on} / title", f"{before} = {{}}{on}", value)
        yield place_of(f"Light / {title}{on} / figcaption", section)


def sweep_lines(sweep, designs):
    """Entries of the screen."""
    title = f"{sweep.vary}, {len(designs)} designs"
    yield shown(title, title)
    for value, results in designs.items():
        label, light, design = f"{title} / {value:g}", results.light.first, results.design
        yield with_error(label, light.nmse).after("NMSE ")
        if light.uniformity is not None:
            yield with_error(label, light.uniformity).after("uniformity ")
        yield with_error(label, light.efficiency, " %", 100.0).after("efficiency ")
        yield shown(label, ", radius {} mm, height {} mm", design.max_radius_mm, design.height_mm)
        missed = sum(not each.passed for _, each in results.criteria())
        if missed:
            yield shown(label, f"; {{}} {'criterion' if missed == 1 else 'criteria'} missed", missed)
