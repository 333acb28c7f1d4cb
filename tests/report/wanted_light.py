"""Numbers on the light that the report must show, by their label, each from the records of the folder."""

import numpy as np
from shown_numbers import shown, with_error

from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.search.scene_check import asked_light
from lensforge.sources.build_source import build_source
from lensforge.spec.source_sections import RayfileSource

ASKED = "Asked, got, possible"


def light_numbers(results):
    """Entries of the first table, of the cards and of the sections on light and photometry."""
    light, spec = results.find(Light), results.spec
    if light is not None:
        yield from _limits(light, spec)
        for receiver, section in zip(light.receivers, spec.all_receivers, strict=True):
            several = len(light.receivers) > 1
            yield from _asked(receiver, section, results, f", {receiver.name}" if several else "")
            yield from _mask(receiver, section, f", {receiver.name}" if several else "")
            yield from _pictures(receiver, section, light, several)
            yield from _region(receiver, light, several)
            yield from _inner(receiver, f", {receiver.name}" if several else "")
        yield from _level(light, spec)
        yield from _preset(light)
    found = results.find(Photometry)
    if found is not None:
        yield from _far_field(found)
    if found is not None and found.road is not None:
        yield from _lamp(found.road, spec)


def watts_to_shown(light, receiver):
    """Unit in which the light on ``receiver`` is shown, its quantity, and how much of it a watt is."""
    far = receiver.kind == "far_field"
    if light.lumens_per_watt is None:
        return ("W/sr", "intensity", 1.0) if far else ("W/m²", "irradiance", 1.0)
    return ("cd", "luminous intensity", light.lumens_per_watt) if far else ("lx", "illuminance", light.lumens_per_watt)


def window_of(receiver, section):
    """Words on the window, and its numbers."""
    if receiver.kind == "far_field":
        return "{}° from the axis", (section.half_angle_deg,)
    return "{} × {} mm", (receiver.window.width, receiver.window.height)


def mask_of(section):
    """Words on the region of uniform light and its sides; None without one."""
    target = section.targets[0]
    for side, unit in ((getattr(target, "uniform_mm", None), " mm"), (getattr(target, "uniform_deg", None), "°")):
        if side is not None:
            return f"{{}}{unit}", (side[0] if isinstance(side, tuple) else side,)
    return None


def transmitted(lens):
    """Share of the light that passes both faces at normal incidence: by Fresnel, or what a coating does not reflect."""
    section, share = lens.spec.lens, 1.0
    for coating, around in (
        (section.inner_coating, section.cavity_index),
        (section.outer_coating, section.outside_index),
    ):
        n = section.refractive_index
        share *= 1.0 - (((n - around) / (n + around)) ** 2 if coating is None else coating.reflectance[0][0])
    return share


def wanted_share(receiver):
    """Share of the target's own light where it is above a tenth of its peak."""
    target = receiver.target_map
    return float(target[target > 0.1 * target.max()].sum() / target.sum())


def _limits(light, spec):
    possible = {}
    if light.limits and not isinstance(spec.source, RayfileSource):
        possible = {each.name: each.possible for each in asked_light(spec, build_source(spec.source))[1]}
    for limit in light.limits:
        sign = {">=": "≥", "<=": "≤"}[limit.sense]
        yield shown(f"{ASKED} / {limit.name} / Asked", f"{sign} {{}} {limit.unit}", limit.bound)
        yield with_error(f"{ASKED} / {limit.name} / Got", limit.value, f" {limit.unit}")
        if limit.sense == ">=":
            yield shown(f"{ASKED} / {limit.name} / Possible", f"≤ {{}} {limit.unit}", possible[limit.name])


def _asked(receiver, section, results, where):
    passed = transmitted(results.lens) * wanted_share(receiver)
    least = 0.7 * min(passed, receiver.possible.share_in_target)
    target, pattern, detected = (
        f"{ASKED} / {name}{where}" for name in ("Light in the target", "Error of the pattern (NMSE)", "Efficiency")
    )
    yield with_error(f"{target} / Got", receiver.share_in_target, "\u2009%", 100.0)
    yield shown(f"{target} / Possible", "≤ {}\u2009%", 100.0 * receiver.possible.share_in_target)
    yield with_error(f"{pattern} / Got", receiver.nmse)
    yield shown(f"{pattern} / Possible", "≥ {}", receiver.possible.nmse)
    yield with_error(f"{detected} / Got", receiver.efficiency, "\u2009%", 100.0)
    yield shown(f"{detected} / Possible", "≤ {}\u2009%", 100.0 * receiver.possible.efficiency)
    words, sides = window_of(receiver, section)
    yield shown(f"{detected} / note", f"share of the LED’s flux within {words}", *sides)
    if not results.spec.limits:
        yield shown(f"{target} / Asked / note", "passes from {}\u2009%", 100.0 * least)
        yield shown(f"{pattern} / Asked / note", "passes up to {}", 0.1)


def _mask(receiver, section, where):
    """Evenness in the mask."""
    for metric, name, meaning in (
        (receiver.uniformity, "Uniformity", "least over mean"),
        (receiver.rsd, "Relative standard deviation (RSD)", "standard deviation over mean"),
    ):
        if metric is not None:
            words, sides = mask_of(section)
            yield with_error(f"{ASKED} / {name}{where} / Got", metric)
            yield shown(f"{ASKED} / {name}{where} / note", f"{meaning} in the mask of {words}", *sides)


def level_of(light, spec):
    """The mean in the mask of the first receiver, or the peak where there is none: its name, and its value in watts."""
    first, mask = light.first, mask_of(spec.all_receivers[0])
    quantity = watts_to_shown(light, first)[1]
    if mask is None:
        return f"Peak {quantity}", float(first.map.max())
    return f"Mean {quantity}", float(first.map[_inside(first, spec.all_receivers[0].size, mask[1][0])].mean())


def _level(light, spec):
    """Card of it."""
    first, mask, several = light.first, mask_of(spec.all_receivers[0]), len(light.receivers) > 1
    (unit, _, per_watt), (name, watts) = watts_to_shown(light, first), level_of(light, spec)
    plain, words, sides = "W/sr" if first.kind == "far_field" else "W/m²", "", ()
    if mask is not None:
        words, sides = f"in the mask of {mask[0]}" + (f" on {first.name}" if several else ""), mask[1]
    label = f"{ASKED} / card / {name}"
    yield shown(label, f"{{}} {unit}", per_watt * watts)
    if unit != plain:
        words, sides = f"{words}; {{}} {plain}".removeprefix("; "), (*sides, watts)
    if sides:
        yield shown(f"{label} / note", words, *sides)


def _inside(receiver, size, side):
    """Pixels whose centres lie in a centred square of ``side``, mm or in the far field degrees."""
    rows, columns = receiver.map.shape
    width, height = size
    x, y = (((np.arange(count) + 0.5) / count - 0.5) * length for count, length in ((columns, width), (rows, height)))
    # Of a chart of equal areas the distance from the centre is 2 sin(gamma / 2).
    half = 2.0 * np.sin(np.radians(side) / 4.0) if receiver.kind == "far_field" else side / 2.0
    return (np.abs(y)[:, None] <= half) & (np.abs(x)[None, :] <= half)


def _preset(light):
    if light.fitted is not None:
        card, fitted = f"{ASKED} / card / NMSE of fitted rays", light.fitted
        yield shown(card, "{}", fitted.nmse.value)
        yield shown(f"{card} / note", "± {}; by the", fitted.nmse.standard_error)
        yield shown(f"{card} / note", "by the {} rays of the search", fitted.rays)
        yield shown(f"{card} / note", "efficiency {}\u2009%", 100.0 * fitted.efficiency.value)
    if light.preset_error is None:
        return
    card, left = f"{ASKED} / card / Simulation error", light.preset_error.evaluation
    yield shown(card, "{}", left.irradiance_nmse.value)
    yield shown(f"{card} / note", "± {}; NMSE that the tables", left.irradiance_nmse.standard_error)
    yield shown(f"{card} / note", "hits {} mm off (rms)", left.hit_mm.value)
    yield shown(f"{card} / note", "; ray noise {}", light.first.nmse_of_noise)


def _pictures(receiver, section, light, several):
    """Captions of the pictures."""
    rows, columns = receiver.map.shape
    fold, title = "Lines across, isolines, encircled energy and flux budget", "Simulated"
    if several:
        title = f"{receiver.name}, {receiver.place}"
        fold = f"Target, difference, lines across, isolines, encircled energy and flux budget: {title}"
        yield shown(f"Light / {title} / title", title)
        yield shown(f"Light / {fold} / summary", fold)
    caption = "{} rays, {} × {} pixels. 3 × 3 Gaussian, variance 1 pixel²."
    yield shown(f"Light / {title} / figcaption", caption, light.rays, columns, rows)
    mask = mask_of(section)
    if mask is not None:
        yield shown(f"Light / {title} / figcaption", f"Dashed: the mask of {mask[0]}.", *mask[1])
    for axis in "xy":
        yield shown(f"Light / {fold} / Along {axis} = 0 / title", f"Along {axis} = 0")
    words, sides = window_of(receiver, section)
    yield shown(f"Light / {fold} / Flux budget / figcaption", f"Window: {words}.", *sides)
    if receiver is light.first:
        first = f"{ASKED} / The light, on the target’s scale / figcaption"
        yield shown(first, f"{watts_to_shown(light, receiver)[1]} {receiver.place}")


def _region(receiver, light, several):
    """Mean and uniformities in the region of uniform light."""
    region = receiver.in_region
    if region is None:
        return
    unit, quantity, per_watt = watts_to_shown(light, receiver)
    title = f"Photometry / On {receiver.name}" if several else "Photometry / On the receiver"
    yield with_error(f"{title} / mean {quantity}", region.mean, f" {unit}", per_watt)
    yield with_error(f"{title} / U0, least over mean", region.u0)
    yield with_error(f"{title} / U1, least over largest", region.u1)


def _inner(receiver, where):
    """Evenness without the rim of the region, and the peak, in the first table."""
    if receiver.in_region is not None:
        even = f"{ASKED} / Evenness of the inner 90\u2009%{where}"
        place = {"uniform": "in the region of uniform light", "bright": "where the target is above half of its maximum"}
        words = f"least over mean light {place[receiver.in_region.region]}, without its rim, which leaves {{}}\u2009%"
        yield with_error(f"{even} / Got", receiver.in_region.inner)
        yield shown(f"{even} / note", words, 100.0 * receiver.in_region.inner_share)
        yield with_error(f"{ASKED} / Peak to target{where} / Got", receiver.in_region.peak)


def _far_field(found):
    title = "Photometry / Far field"
    yield shown("Photometry / p", "By {} rays", found.rays)
    yield shown("Photometry / p", "the table's noise is {}\u2009% rms", 100.0 * found.node_error.rms)
    yield shown("Photometry / Polar diagram / figcaption", "gamma = 0 is the axis")
    yield with_error(f"{title} / light that leaves the lens", found.exit_lm, " lm")
    yield with_error(f"{title} / peak intensity", found.peak_cd, " cd")
    yield with_error(f"{title} / intensity on the axis", found.axis_cd, " cd")
    direction = found.peak_direction
    yield shown(f"{title} / direction of the peak", "C {}, gamma {}°", direction.c_deg, direction.gamma_deg)
    for plane, beam in (("C 0 – C 180", found.beam_c0), ("C 90 – C 270", found.beam_c90)):
        yield with_error(f"{title} / beam angle (50 %), {plane}", beam.beam_angle_deg, "°")
        yield with_error(f"{title} / field angle (10 %), {plane}", beam.field_angle_deg, "°")


def _lamp(road, spec):
    title, lit, glare = "Photometry / Lamp", road.road, road.glare
    yield shown(f"{title} / lenses", "{}", spec.photometry.lenses)
    yield with_error(f"{title} / light of the lamp", road.lumens, " lm")
    yield with_error(f"{title} / half of the peak reaches", road.distribution.street_mh, " heights to the street")
    rating = road.bug
    words = "B{} U{} G{}"
    yield shown(f"{title} / BUG rating", words, rating.backlight, rating.uplight, rating.glare)
    yield shown(f"{title} / glare class (EN 13201)", glare.glare_class)
    most = f"{title} / most cd/klm from 70° and from 80°"
    yield shown(most, "{}; {}", glare.above_70.value, glare.above_80.value)
    yield with_error(f"{title} / mean illuminance", lit.mean_lx, " lx")
    yield with_error(f"{title} / least illuminance", lit.least_lx, " lx")
    yield with_error(f"{title} / U0 on the road", lit.uniformity)
    yield shown(f"{title} / classes (EN 13201)", f"P: {lit.p_class}; C: {lit.c_class}")
    fold = "Photometry / More: Isocandela, On the ground, Zones"
    for side in ("forward", "back"):
        for name, low, high in (("low", 0, 30), ("mid", 30, 60), ("high", 60, 80), ("very_high", 80, 90)):
            lumens = getattr(rating.zones, f"{side}_{name}")
            yield with_error(f"{fold} / Zones / {side}, {low}° to {high}°", lumens, " lm")
