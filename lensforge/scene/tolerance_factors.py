"""The tolerances of a spec as factors: independent causes, each drawn anew for every part."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lensforge.errors import InputError
from lensforge.results.numerals import percent, quantity
from lensforge.spec.tolerances_section import Distribution, TolerancesSection

Kind = Literal["spread", "one-sided", "field"]
_UNITS = {"_mm": ("mm", 1.0), "_deg": ("deg", float(np.pi / 180.0)), "_um": ("um", 1e-3), "_mrad": ("mrad", 1e-3)}


@dataclass(frozen=True)
class Factor:
    """One tolerance: ``amount`` in ``unit``, which is ``to_internal`` mm, rad or 1.

    ``kind``: "spread" to both sides by ``distribution``; "one-sided", from none to the amount; or the "field" of a
    form error, whose ``numbers`` are Gaussian and make up its shape. ``numbers``: drawn for each part.
    """

    name: str
    words: str
    unit: str
    to_internal: float
    amount: float
    kind: Kind
    distribution: Distribution
    numbers: int


_SYMBOLS = {"deg": "°", "um": "µm"}
_IN_PER_CENT = ("source_flux", "source_size", "shrinkage")
_BOTH, _ONE = 2, 1
_SPREAD = {
    "source_shift_mm": ("source, decentre", _BOTH),
    "source_height_mm": ("source, height", _ONE),
    "source_tilt_deg": ("source, tilt", _BOTH),
    "source_flux": ("source, flux", _ONE),
    "source_size": ("source, size", _ONE),
    "outer_shift_mm": ("outer face against inner, decentre", _BOTH),
    "gap_mm": ("outer face against inner, gap", _ONE),
    "outer_tilt_deg": ("outer face against inner, tilt", _BOTH),
    "lens_shift_mm": ("lens against source, decentre", _BOTH),
    "lens_height_mm": ("lens against source, height", _ONE),
    "lens_tilt_deg": ("lens against source, tilt", _BOTH),
    "index": ("refractive index", _ONE),
    "shrinkage": ("shrinkage", _ONE),
}
_ONE_SIDED = {
    "inner_roughness_mrad": "roughness, inner face",
    "outer_roughness_mrad": "roughness, outer face",
    "inner_ripple_um": "ripple, inner face",
    "outer_ripple_um": "ripple, outer face",
}
_FIELDS = {
    "inner_form_um": "form, inner face",
    "outer_form_um": "form, outer face",
    "inner_waviness_um": "waviness, inner face",
    "outer_waviness_um": "waviness, outer face",
}
FORM_NUMBERS = 9  # functions over the hemisphere: errors as wide as astigmatism and coma
# Waviness has hundreds of independent parts; sums of so many prepared fields vary over lenses by a quarter of their
# mean effect at most, sqrt(2/32), and take 3 ms each.
WAVINESS_NUMBERS = 32


def amount_words(name: str, value: float, unit: str) -> str:
    """Amount of the tolerance ``name`` with its unit; shares in per cent."""
    return percent(value) if name in _IN_PER_CENT else quantity(value, _SYMBOLS.get(unit, unit), digits=3)


def factors_of(section: TolerancesSection) -> tuple[Factor, ...]:
    """All tolerances of ``section`` that are not 0.

    Raises :class:`InputError` where all are 0.
    """
    found = []
    for name, (words, numbers) in _SPREAD.items():
        found.append(_factor(section, name, words, "spread", numbers))
    found += [_factor(section, name, words, "one-sided", 1) for name, words in _ONE_SIDED.items()]
    for name, words in _FIELDS.items():
        numbers = FORM_NUMBERS if "form" in name else WAVINESS_NUMBERS
        found.append(_factor(section, name, words, "field", numbers))
    found = [factor for factor in found if factor.amount > 0.0]
    if not found:
        raise InputError("tolerances: all of them are 0: every part is as designed; raise one, or leave out the zeros")
    return tuple(found)


def _factor(section: TolerancesSection, name: str, words: str, kind: Kind, numbers: int) -> Factor:
    tolerance = section.of(name)
    unit, to_internal = next((found for end, found in _UNITS.items() if name.endswith(end)), ("", 1.0))
    return Factor(name, words, unit, to_internal, tolerance.amount, kind, tolerance.distribution, numbers)
