"""Tolerances that page and PDF for the shop must show: amounts of the spec, and the largest ones of the yield study."""

from shown_numbers import shown

from lensforge.made.tolerance_result import Yield
from lensforge.scene.tolerance_factors import factors_of

_IN_PER_CENT = ("source_flux", "source_size")
_UNITS = {"deg": "°", "um": " µm", "": ""}


def tolerance_numbers(results):
    """Entries of every tolerance, and of the sentence above them."""
    section, found = results.spec.tolerances, results.find(Yield)
    largest = {} if found is None else {row.tolerance: row for row in found.budget.alone}
    if found is not None:
        words = "{}\u2009% of {} parts drawn from these amounts pass. At most: the amount at which {}\u2009% of them"
        shares = (100.0 * found.pass_rate.value, found.parts, 100.0 * found.budget.pass_rate)
        yield shown("Tolerances / p", words, *shares)
        yield shown("PDF / Tolerances", words, *shares)
    for factor in factors_of(section):
        factor_of, unit = _unit(factor)
        sign, what = _kind(factor.name)
        amount, value = f"{sign}{{}}{unit}{what}", factor_of * section.of(factor.name).amount
        group = "LED and mounting" if factor.name.startswith(("source_", "lens_")) else "The lens"
        label = f"Tolerances / {group} / {factor.words}"
        yield shown(f"{label} / Amount", amount, value)
        row = largest.get(factor.name)
        if row is None:
            yield shown(f"PDF / {group} / {factor.words} / Amount", amount, value)
            continue
        most, limit = ("above ", row.searched_to) if row.unlimited else ("", row.at_most)
        yield shown(f"{label} / At most", f"{most}{{}}{unit}", factor_of * limit)
        yield shown(f"PDF / {group} / {factor.words} / Amount", amount, value)
        yield shown(f"PDF / {group} / {factor.words} / At most", f"{most}{{}}{unit}", factor_of * limit)


def _unit(factor):
    return (100.0, "\u2009%") if factor.name in _IN_PER_CENT else (1.0, _UNITS.get(factor.unit, f" {factor.unit}"))


def _kind(name):
    """What stands before and after an amount: either way, rms, or peak to valley."""
    if name.endswith(("_form_um", "_waviness_um")):
        return "", " rms"
    if name.endswith("_ripple_um"):
        return "", " peak to valley"
    return ("", "") if name.endswith("_roughness_mrad") else ("± ", "")
