"""The ``[tolerances]`` of a spec: what may be wrong with a part, its mounting and its LED, and by how much.

Sources of the presets. Injection moulding and diamond turning: Apollo Optical Systems, "Typical manufacturing
tolerances" (apollooptical.com/manufacturing-tolerances, seen in 2026): concentricity 0.025 mm moulded, 0.005 mm turned;
centre thickness 0.025 and 0.015 mm moulded, 0.02 and 0.005 mm turned; irregularity of 6, 3 and 2 fringes (632.8 nm)
over 25 mm, moulded commercial and precision, turned precision: 1.9, 0.9 and 0.6 um peak to valley, about a fifth of
which is its rms; power of 10 fringes besides. Index: +-0.001 of plastics (Baeumer, Handbook of Plastic Optics, 2nd ed.,
2010), +-0.0005 of catalogue glass (ISO 12123, grade NP050). The place of a chip in its package and of a package on its
board (data sheets state 0.05 to 0.1 mm), its tilt, flux within a bin, waviness, ripple and roughness are our estimates:
give your own where you know them.
"""

from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from lensforge.errors import InputError
from lensforge.results.numerals import percent, quantity
from lensforge.spec.spec_files import read_toml
from lensforge.spec.spec_section import Section, spec_error

TolerancePreset = Literal["precision", "standard", "moulded"]

FactorKind = Literal["spread", "one-sided", "field"]
FORM_NUMBERS = 9  # functions over the hemisphere: errors as wide as astigmatism and coma
# Waviness has hundreds of independent parts; sums of so many prepared fields vary over lenses by a quarter of their
# mean effect at most, sqrt(2/32), and take 3 ms each.
WAVINESS_NUMBERS = 32


class _Cause(NamedTuple):
    """A tolerance: its words, its amounts in precision, standard and moulded, and the numbers of each part."""

    words: str
    amounts: tuple[float, float, float]
    numbers: int = 1
    kind: FactorKind = "spread"


# In the order in which parts are drawn: the numbers of a part depend on it.
_CAUSES = {
    "source_shift_mm": _Cause("source, decentre", (0.02, 0.05, 0.05), 2),
    "source_height_mm": _Cause("source, height", (0.02, 0.05, 0.05)),
    "source_tilt_deg": _Cause("source, tilt", (0.2, 0.5, 0.5), 2),
    "source_flux": _Cause("source, flux", (0.05, 0.05, 0.05)),
    "source_size": _Cause("source, size", (0.01, 0.02, 0.02)),
    "outer_shift_mm": _Cause("outer face against inner, decentre", (0.005, 0.02, 0.025), 2),
    "gap_mm": _Cause("outer face against inner, gap", (0.005, 0.02, 0.025)),
    "outer_tilt_deg": _Cause("outer face against inner, tilt", (0.02, 0.05, 0.05), 2),
    "lens_shift_mm": _Cause("lens against source, decentre", (0.02, 0.05, 0.05), 2),
    "lens_height_mm": _Cause("lens against source, height", (0.01, 0.03, 0.05)),
    "lens_tilt_deg": _Cause("lens against source, tilt", (0.05, 0.1, 0.2), 2),
    "index": _Cause("refractive index", (0.0005, 0.001, 0.001)),
    "shrinkage": _Cause("shrinkage", (0.0, 0.0, 0.001)),
    "inner_roughness_mrad": _Cause("roughness, inner face", (0.2, 0.5, 0.5), 1, "one-sided"),
    "outer_roughness_mrad": _Cause("roughness, outer face", (0.2, 0.5, 0.5), 1, "one-sided"),
    "inner_ripple_um": _Cause("ripple, inner face", (0.01, 0.02, 0.0), 1, "one-sided"),
    "outer_ripple_um": _Cause("ripple, outer face", (0.01, 0.02, 0.0), 1, "one-sided"),
    "inner_form_um": _Cause("form, inner face", (0.3, 1.0, 2.0), FORM_NUMBERS, "field"),
    "outer_form_um": _Cause("form, outer face", (0.3, 1.0, 2.0), FORM_NUMBERS, "field"),
    "inner_waviness_um": _Cause("waviness, inner face", (0.03, 0.1, 0.2), WAVINESS_NUMBERS, "field"),
    "outer_waviness_um": _Cause("waviness, outer face", (0.03, 0.1, 0.2), WAVINESS_NUMBERS, "field"),
}
_PRESETS: tuple[TolerancePreset, ...] = get_args(TolerancePreset)
PRESET_AMOUNTS: dict[TolerancePreset, dict[str, float]] = {
    preset: {name: cause.amounts[number] for name, cause in _CAUSES.items()} for number, preset in enumerate(_PRESETS)
}


Distribution = Literal["uniform", "normal", "truncated"]


class ToleranceSpec(Section):
    """One tolerance, and how parts are spread over it."""

    amount: Annotated[float, Field(ge=0.0)]
    """Amount either way, in the unit of the tolerance."""
    distribution: Distribution = "truncated"
    """Spread: "uniform", anywhere within the amount; "normal", Gaussian, 95 % of the parts within it (its standard
    deviation is half the amount); "truncated", the same without the parts beyond it, which inspection has sorted out.
    """

    @model_validator(mode="after")
    def _has_a_width(self) -> "ToleranceSpec":
        if self.amount == 0.0 and "distribution" in self.model_fields_set:
            raise ValueError("amount = 0: a distribution has a width; raise it, or write 0 alone for an exact part")
        return self


def _from_number(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"amount": value}
    if not isinstance(value, dict | ToleranceSpec):
        raise ValueError('must be a number, or a table such as { amount = 0.05, distribution = "normal" }')
    return value


_Amount = Annotated[float, Field(ge=0.0, le=100.0)]
_Tolerance = Annotated[ToleranceSpec, BeforeValidator(_from_number, json_schema_input_type=_Amount | ToleranceSpec)]

# By the end of the name: unit, factor to mm, rad or 1, and largest amount; beyond it, a part is another part.
_UNITS = {
    "_mm": ("mm", 1.0, 5.0),
    "_deg": ("deg", pi / 180.0, 20.0),
    "_um": ("um", 1e-3, 100.0),
    "_mrad": ("mrad", 1e-3, 100.0),
    "source_flux": ("", 1.0, 0.5),
    "source_size": ("", 1.0, 0.5),
    "index": ("", 1.0, 0.1),
    "shrinkage": ("", 1.0, 0.1),
}
_SYMBOLS = {"deg": "°", "um": "µm"}
_IN_PER_CENT = ("source_flux", "source_size", "shrinkage")


def _unit_of(name: str) -> tuple[str, float, float]:
    return next(unit for end, unit in _UNITS.items() if name.endswith(end))


def amount_words(name: str, value: float, unit: str) -> str:
    """Amount of the tolerance ``name`` with its unit; shares in per cent."""
    return percent(value) if name in _IN_PER_CENT else quantity(value, _SYMBOLS.get(unit, unit), digits=3)


class TolerancesSection(Section):
    """Tolerances: a number, or ``{ amount = 0.05, distribution = "normal" }``; 0 for none.

    What is left out comes from ``preset``. Roughness and ripple are between none and their amount; the shapes of form
    and waviness are drawn anew for every part.
    """

    preset: TolerancePreset = "standard"
    """Amounts of the tolerances that are left out (docs/definitions.md, section 16)."""
    source_shift_mm: _Tolerance | None = None
    """Shift of the LED against its place in the spec, in x and in y."""
    source_height_mm: _Tolerance | None = None
    """Shift of the LED along z."""
    source_tilt_deg: _Tolerance | None = None
    """Tilt of the LED about x and about y."""
    source_flux: _Tolerance | None = None
    """Error of the LED's flux, as a share."""
    source_size: _Tolerance | None = None
    """Error of the LED's size, as a share."""
    outer_shift_mm: _Tolerance | None = None
    """Shift of the outer face against the inner one, in x and in y."""
    gap_mm: _Tolerance | None = None
    """Shift of the outer face against the inner one along z."""
    outer_tilt_deg: _Tolerance | None = None
    """Tilt of the outer face against the inner one, about x and about y."""
    lens_shift_mm: _Tolerance | None = None
    """Shift of the whole lens against LED and receivers, in x and in y."""
    lens_height_mm: _Tolerance | None = None
    """Shift of the whole lens along z."""
    lens_tilt_deg: _Tolerance | None = None
    """Tilt of the whole lens about x and about y."""
    inner_form_um: _Tolerance | None = None
    """Error of form of the inner face as wide as astigmatism and coma, rms over parts and face."""
    outer_form_um: _Tolerance | None = None
    """Error of form of the outer face as wide as astigmatism and coma, rms over parts and face."""
    inner_waviness_um: _Tolerance | None = None
    """Finer errors of the inner face, rms over parts and face."""
    outer_waviness_um: _Tolerance | None = None
    """Finer errors of the outer face, rms over parts and face."""
    inner_ripple_um: _Tolerance | None = None
    """Rings of the cutter about the axis on the inner face, peak to valley."""
    outer_ripple_um: _Tolerance | None = None
    """Rings of the cutter about the axis on the outer face, peak to valley."""
    inner_roughness_mrad: _Tolerance | None = None
    """Slope of the inner face's roughness along any line, rms."""
    outer_roughness_mrad: _Tolerance | None = None
    """Slope of the outer face's roughness along any line, rms."""
    index: _Tolerance | None = None
    """Error of the index, of the batch."""
    shrinkage: _Tolerance | None = None
    """Change of all lengths, as a share."""
    waviness_shortest_mm: Annotated[float, Field(ge=0.01, le=100.0)] = 0.5
    """Shortest period of the waviness."""
    waviness_longest_mm: Annotated[float, Field(ge=0.01, le=100.0)] = 5.0
    """Longest period of the waviness."""
    ripple_period_mm: Annotated[float, Field(ge=1e-3, le=10.0)] = 0.1
    """Distance of the rings that the cutter leaves about the axis."""

    @model_validator(mode="after")
    def _amounts_are_small(self) -> "TolerancesSection":
        for name in _CAUSES:
            tolerance, (_, _, most) = getattr(self, name), _unit_of(name)
            if tolerance is None:
                continue
            if tolerance.amount > most:
                raise ValueError(f"{name} = {tolerance.amount:g}: must be at most {most:g}")
            if name.endswith("_um") and "distribution" in tolerance.model_fields_set:
                raise ValueError(
                    f"{name}: the shape of a face's error is Gaussian, and its amount the rms over all parts; leave "
                    "out distribution"
                )
        return self

    @model_validator(mode="after")
    def _band_is_a_band(self) -> "TolerancesSection":
        if self.waviness_shortest_mm >= self.waviness_longest_mm:
            raise ValueError(
                f"waviness_shortest_mm = {self.waviness_shortest_mm:g}: must be below waviness_longest_mm = "
                f"{self.waviness_longest_mm:g}"
            )
        return self

    def of(self, name: str) -> ToleranceSpec:
        """The tolerance ``name``: as given, or that of the preset."""
        given: ToleranceSpec | None = getattr(self, name)
        return ToleranceSpec(amount=PRESET_AMOUNTS[self.preset][name]) if given is None else given


@dataclass(frozen=True)
class Factor:
    """One tolerance as a cause of its own, drawn for every part: ``amount`` in ``unit``, ``to_internal`` mm, rad or 1.

    ``kind``: "spread" to both sides by ``distribution``; "one-sided", from none to the amount; or the "field" of a
    form error, whose ``numbers`` are Gaussian and make up its shape. ``numbers``: drawn for each part.
    """

    name: str
    words: str
    unit: str
    to_internal: float
    amount: float
    kind: FactorKind
    distribution: Distribution
    numbers: int


def factors_of(section: TolerancesSection) -> tuple[Factor, ...]:
    """All tolerances of ``section`` that are not 0. Raises :class:`InputError` where all are 0."""
    found = []
    for name, cause in _CAUSES.items():
        tolerance, (unit, to_internal, _) = section.of(name), _unit_of(name)
        if tolerance.amount > 0.0:
            stated = (cause.words, unit, to_internal, tolerance.amount, cause.kind)
            found.append(Factor(name, *stated, tolerance.distribution, cause.numbers))
    if not found:
        raise InputError("tolerances: all of them are 0: every part is as designed; raise one, or leave out the zeros")
    return tuple(found)


def read_tolerances(name: str) -> TolerancesSection:
    """Tolerances of a preset, or of a TOML file with a section of that name.

    Raises :class:`InputError` where there is neither.
    """
    if name in PRESET_AMOUNTS:
        return TolerancesSection(preset=name)
    content = read_toml(Path(name), f"give {', '.join(PRESET_AMOUNTS)}, or a TOML file").get("tolerances")
    if not isinstance(content, dict):
        raise InputError(f"{name}: has no [tolerances]; give {', '.join(PRESET_AMOUNTS)}, or a file that has")
    try:
        return TolerancesSection.model_validate(content)
    except ValidationError as error:
        raise spec_error(error, f"{name}: tolerances", TolerancesSection) from None
