"""Numbers of studies that the report must show, by their label: stray light, sensitivity, tolerances and yield."""

import math

from shown_numbers import shown, with_error
from wanted_light import ASKED
from wanted_yield import budget_numbers, passing_numbers

from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.stray_result import StrayLight
from lensforge.report.yield_rows import metric_words


def study_numbers(results):
    """Entries of every study in the folder."""
    stray, change, found = results.find(StrayLight), results.find(Sensitivity), results.find(Yield)
    if stray is not None:
        yield from _stray(stray)
    if change is not None:
        yield from _sensitivity(change)
    if found is not None:
        yield from passing_numbers(found, "Tolerances and yield / p", "Tolerances and yield")
        yield from _causes(found)
        yield from budget_numbers(found, "Tolerances and yield / How large each tolerance may be")


def _stray(stray):
    yield shown(f"{ASKED} / card / Stray light", "{}\u2009%", 100.0 * stray.first.flux.detected_stray)
    followed = "({} rays, black base, absorption {} per mm)"
    yield shown("Stray light / p", followed, stray.rays, stray.absorption_per_mm)
    fold = "Stray light / Flux budget with all reflections, and the stray light on the receiver"
    several = len(stray.receivers) > 1
    for each in stray.receivers:
        window, place = (f"the window of {each.name}", each.name) if several else ("the window", "the receiver")
        gain = each.efficiency - each.efficiency_sequential
        sentence = (
            f"{{}}\u2009% of the emitted flux lands in {window} as stray light, {{}}\u2009% is absorbed, and the "
            f"efficiency is {{}}\u2009% instead of {{}}\u2009% ({'+' if gain >= 0.0 else '−'}{{}} points). "
            f"On {place} the sequential model is wrong by {{}}\u2009% of the flux, an NMSE of {{}}."
        )
        flux = each.flux
        shares = (flux.detected_stray, flux.absorbed, each.efficiency, each.efficiency_sequential, abs(gain))
        shares = [100.0 * share for share in (*shares, each.misplaced_flux)]
        yield shown("Stray light / p", sentence, *shares, each.nmse_vs_sequential)
        caption = f"{fold} / Stray light on the receiver{f', {each.name}' if several else ''} / figcaption"
        yield shown(caption, "its peak is {}\u2009% of the mean light", 100.0 * each.spread.peak_of_mean)
        unit = "°" if each.far_field else "mm"
        yield shown(caption, f"Rms distance from its centroid: {{}} {unit}.", _radius(each))


def _radius(each):
    """Radius in mm; of the far field in degrees, from that on the chart, 2 sin(gamma / 2)."""
    radius = each.spread.rms_radius
    return math.degrees(2.0 * math.asin(min(0.5 * radius, 1.0))) if each.far_field else radius


def _sensitivity(found):
    fold = f"Sensitivity / Changes by each of {len(found.rows)} errors"
    yield shown(f"{fold} / summary", "Changes by each of {} errors", len(found.rows))
    for row in found.rows:
        yield shown(f"{fold} / {row.name} / Amount", f"{{}} {row.unit}", row.amount)
        for name, column in (
            ("nmse", "NMSE"),
            ("uniformity", "Uniformity"),
            ("rsd", "RSD"),
            ("efficiency", "Efficiency"),
        ):
            yield with_error(f"{fold} / {row.name} / {column}", getattr(row.change, name))


def _causes(found):
    fold = "Tolerances and yield / What the scatter comes from"
    for name, variance in found.variance.items():
        label = f"{fold} / {metric_words(name)} / Main causes, with their shares of the variance"
        named = [(each.words, each.share, each.standard_error) for each in variance.causes[:3] if each.share > 0.005]
        together = variance.interactions
        for words, share, error in (*named, ("several together", together.value, together.standard_error)):
            yield shown(label, f"{words} {{}}\u2009% ± {{}}\u2009%", 100.0 * share, 100.0 * error)
