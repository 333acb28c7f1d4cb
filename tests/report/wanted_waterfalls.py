"""Shares of the flux that the waterfalls of the report write beside their bars."""

from shown_numbers import Place, shown

from lensforge.light.evaluation_result import Light
from lensforge.proof.stray_result import StrayLight
from lensforge.report.flux_figures import flux_budget
from lensforge.report.stray_light import stray_budget


def flux_places(results):
    """Labels and shares of the bars, as drawn."""
    light, stray = results.find(Light), results.find(StrayLight)
    figures = [("Flux budget", flux_budget(each.flux, each.missed_by_cause)) for each in _receivers(light)]
    figures += [("Flux budget with all reflections", stray_budget(each)) for each in _receivers(stray)]
    for (title, figure), each in zip(figures, [*_receivers(light), *_receivers(stray)], strict=True):
        texts = [text.get_text() for text in figure.axes[0].texts]
        for label, share in zip(texts[::2], texts[1::2], strict=True):
            yield Place(f"{title} / {each.name} / {label}", share)


def _receivers(found):
    return () if found is None else found.receivers


def waterfall_numbers(results):
    """Entries of every bar."""
    for each in _receivers(results.find(Light)):
        yield from _bars(f"Flux budget / {each.name}", _sequential(each))
    for each in _receivers(results.find(StrayLight)):
        yield from _bars(f"Flux budget with all reflections / {each.name}", _reflected(each))


def _bars(title, shares):
    yield shown(f"{title} / emitted", "{} %", 100.0)
    for label, share in shares.items():
        if share > 0.0:
            yield shown(f"{title} / {label}", "{} %", 100.0 * share)


def _sequential(each):
    flux, missed = each.flux, each.missed_by_cause
    return {
        "emitted backwards": missed.backward,
        "started outside the cavity": missed.outside_cavity,
        "hit the base": missed.base,
        "missed the receiver": missed.missed_receiver,
        "met intersecting surfaces": missed.surfaces_intersect,
        "totally reflected": flux.total_reflection,
        "not converged": flux.not_converged,
        "absorbed in the lens": flux.absorbed,
        "reflected at the surfaces": flux.reflected,
        "lost in the cover glass": flux.cover_glass,
        "landed outside the window": flux.outside,
        "detected": flux.detected,
    }


def _reflected(each):
    flux, causes = each.flux, each.detected_stray_by_cause
    return {
        "landed outside the window": flux.outside_direct,
        "stray, outside the window": flux.outside_stray,
        "back to the board": flux.backward,
        "absorbed in the lens": flux.absorbed,
        "lost in the cover glass": flux.cover_glass,
        "absorbed by the base": flux.base,
        "below the flux cut-off": flux.too_dim,
        "leaked at the mesh's edges": flux.leaked,
        "detected as designed": flux.detected_direct,
        "stray: reflected at the cavity": causes.inner_reflection,
        "stray: reflected inside the outer face": causes.outer_reflection,
        "stray: totally reflected": causes.total_reflection,
        "stray: by the base": causes.base,
        "stray: met the lens again": causes.met_again,
    }
