"""The ``[tolerances]`` of a spec, and those of its faces: what may be wrong with a part, its mounting and its LED.

Sources of the presets. Injection moulding and diamond turning: Apollo Optical Systems, "Typical manufacturing
tolerances" (apollooptical.com/manufacturing-tolerances, seen in 2026): concentricity 0.025 mm moulded, 0.005 mm turned;
centre thickness 0.025 and 0.015 mm moulded, 0.02 and 0.005 mm turned; irregularity of 6, 3 and 2 fringes (632.8 nm)
over 25 mm, moulded commercial and precision, turned precision: 1.9, 0.9 and 0.6 um peak to valley, about a fifth of
which is its rms; power of 10 fringes besides. Index: +-0.001 of plastics (Baeumer, Handbook of Plastic Optics, 2nd ed.,
2010), +-0.0005 of catalogue glass (ISO 12123, grade NP050). The place of a chip in its package and of a package on its
board (data sheets state 0.05 to 0.1 mm), its tilt, flux within a bin, waviness, ripple and roughness are our estimates:
give your own where you know them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from lensforge.errors import InputError
from lensforge.optics.media import DOUBLE
from lensforge.results.numerals import percent, quantity
from lensforge.spec.renamed import with_new_names
from lensforge.spec.spec_files import read_toml
from lensforge.spec.spec_section import Section, spec_error

TolerancePreset = Literal["precision", "standard", "moulded"]

FactorKind = Literal["spread", "one-sided", "field"]
FORM_NUMBERS = 9  # functions over the hemisphere: errors as wide as astigmatism and coma
# Waviness has hundreds of independent parts; sums of so many prepared fields vary over lenses by a quarter of their
# mean effect at most, sqrt(2/32), and take 3 ms each.
WAVINESS_NUMBERS = 32


class _Cause(NamedTuple):
    """A tolerance: its words, its amounts in precision, standard and moulded, and the numbers of each part.

    ``field``: its name in the table of its ``face``.
    """

    words: str
    amounts: tuple[float, float, float]
    numbers: int = 1
    kind: FactorKind = "spread"
    face: str | None = None
    field: str = ""


def _of_faces(field: str, cause: _Cause) -> dict[str, _Cause]:
    """The tolerance ``field`` of each face, its words those of the ``cause`` and the face."""
    return {
        f"{face}_{field}": cause._replace(words=f"{cause.words}, {face} face", face=face, field=field)
        for face in DOUBLE
    }


def _placed(field: str, cause: _Cause) -> dict[str, _Cause]:
    """A tolerance of the place of each face against the one before it."""
    return {
        field if field == "gap_mm" else f"{face}_{field}": cause._replace(
            words=f"{face} face against {before}, {cause.words}", face=face, field=field
        )
        for before, face in pairwise(DOUBLE)
    }


# In the order in which parts are drawn: the numbers of a part depend on it.
_CAUSES = {
    "source_shift_mm": _Cause("source, decentre", (0.02, 0.05, 0.05), 2),
    "source_height_mm": _Cause("source, height", (0.02, 0.05, 0.05)),
    "source_tilt_deg": _Cause("source, tilt", (0.2, 0.5, 0.5), 2),
    "source_flux": _Cause("source, flux", (0.05, 0.05, 0.05)),
    "source_size": _Cause("source, size", (0.01, 0.02, 0.02)),
    **_placed("shift_mm", _Cause("decentre", (0.005, 0.02, 0.025), 2)),
    **_placed("gap_mm", _Cause("gap", (0.005, 0.02, 0.025))),
    **_placed("tilt_deg", _Cause("tilt", (0.02, 0.05, 0.05), 2)),
    "lens_shift_mm": _Cause("lens against source, decentre", (0.02, 0.05, 0.05), 2),
    "lens_height_mm": _Cause("lens against source, height", (0.01, 0.03, 0.05)),
    "lens_tilt_deg": _Cause("lens against source, tilt", (0.05, 0.1, 0.2), 2),
    "index": _Cause("refractive index", (0.0005, 0.001, 0.001)),
    "shrinkage": _Cause("shrinkage", (0.0, 0.0, 0.001)),
    **_of_faces("roughness_mrad", _Cause("roughness", (0.2, 0.5, 0.5), 1, "one-sided")),
    **_of_faces("ripple_um", _Cause("ripple", (0.01, 0.02, 0.0), 1, "one-sided")),
    **_of_faces("form_um", _Cause("form", (0.3, 1.0, 2.0), FORM_NUMBERS, "field")),
    **_of_faces("waviness_um", _Cause("waviness", (0.03, 0.1, 0.2), WAVINESS_NUMBERS, "field")),
}
PLACEMENT = ("shift_mm", "gap_mm", "tilt_deg")  # fields of a face: its place against the one before it
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


class _Amounts(Section):
    @model_validator(mode="after")
    def _are_small(self) -> "_Amounts":
        for name in type(self).model_fields:
            if not isinstance(tolerance := getattr(self, name), ToleranceSpec):
                continue
            _, _, most = _unit_of(name)
            if tolerance.amount > most:
                raise ValueError(f"{name} = {tolerance.amount:g}: must be at most {most:g}")
            if name.endswith("_um") and "distribution" in tolerance.model_fields_set:
                raise ValueError(
                    f"{name}: the shape of a face's error is Gaussian, and its amount the rms over all parts; leave "
                    "out distribution"
                )
        return self


class FaceTolerances(_Amounts):
    """Tolerances of a face, and of its place against the face before it: those left out come from the preset."""

    form_um: _Tolerance | None = None
    """Error of form as wide as astigmatism and coma, rms over parts and face."""
    waviness_um: _Tolerance | None = None
    """Finer errors of form, rms over parts and face."""
    ripple_um: _Tolerance | None = None
    """Rings of the cutter about the axis, peak to valley."""
    roughness_mrad: _Tolerance | None = None
    """Slope of the roughness along any line, rms."""
    shift_mm: _Tolerance | None = None
    """Shift of the outer face against the inner one, in x and in y."""
    gap_mm: _Tolerance | None = None
    """Shift of the outer face against the inner one along z."""
    tilt_deg: _Tolerance | None = None
    """Tilt of the outer face against the inner one, about x and about y."""


def refuse_placement(first: tuple[str, FaceTolerances], following: tuple[str, FaceTolerances], *_: object) -> None:
    """Raise ``ValueError`` where the first of some faces, each with its name, has a place of its own."""
    for name in PLACEMENT:
        if getattr(first[1], name) is not None:
            raise ValueError(
                f"{first[0]}.{name}: this face is what the next is placed against; give {following[0]}.{name}"
            )


class TolerancesSection(_Amounts):
    """Tolerances: a number, or ``{ amount = 0.05, distribution = "normal" }``; 0 for none.

    Those of a face stand in its own table, such as ``lens.outer.gap_mm``. What is left out comes from ``preset``.
    Roughness and ripple are between none and their amount; the shapes of form and waviness are drawn anew for every
    part.
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
    lens_shift_mm: _Tolerance | None = None
    """Shift of the whole lens against LED and receivers, in x and in y."""
    lens_height_mm: _Tolerance | None = None
    """Shift of the whole lens along z."""
    lens_tilt_deg: _Tolerance | None = None
    """Tilt of the whole lens about x and about y."""
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
    def _band_is_a_band(self) -> "TolerancesSection":
        if self.waviness_shortest_mm >= self.waviness_longest_mm:
            raise ValueError(
                f"waviness_shortest_mm = {self.waviness_shortest_mm:g}: must be below waviness_longest_mm = "
                f"{self.waviness_longest_mm:g}"
            )
        return self


class PartTolerances(TolerancesSection):
    """All tolerances of a part: the ``[tolerances]`` of a spec, and those of its faces."""

    inner: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the inner face."""
    outer: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the outer face, and of its place against the inner one."""

    @model_validator(mode="after")
    def _first_is_the_reference(self) -> "PartTolerances":
        refuse_placement((DOUBLE[0], self.inner), (DOUBLE[1], self.outer))
        return self

    @staticmethod
    def of(section: TolerancesSection, faces: Mapping[str, FaceTolerances]) -> "PartTolerances":
        """The tolerances of ``section`` with those in the tables of the ``faces``."""
        fields = FaceTolerances.model_fields
        own = {name: FaceTolerances(**{each: getattr(face, each) for each in fields}) for name, face in faces.items()}
        return PartTolerances(**{**section.model_dump(exclude_unset=True), **own})

    def given(self, name: str) -> ToleranceSpec | None:
        """The tolerance of the factor ``name`` where it is given; None for that of the preset."""
        face, field = _CAUSES[name].face, _CAUSES[name].field
        found: ToleranceSpec | None = getattr(self if face is None else getattr(self, face), field or name)
        return found

    def tolerance(self, name: str) -> ToleranceSpec:
        """The tolerance of the factor ``name``: as given, or that of the preset."""
        return self.given(name) or ToleranceSpec(amount=PRESET_AMOUNTS[self.preset][name])


def names_of(*fields: str) -> tuple[str, ...]:
    """Names of the factors that are these ``fields`` in the tables of the faces."""
    return tuple(name for name, cause in _CAUSES.items() if cause.field in fields)


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


def factors_of(tolerances: PartTolerances) -> tuple[Factor, ...]:
    """All ``tolerances`` that are not 0. Raises :class:`InputError` where all are 0."""
    found = []
    for name, cause in _CAUSES.items():
        tolerance, (unit, to_internal, _) = tolerances.tolerance(name), _unit_of(name)
        if tolerance.amount > 0.0:
            stated = (cause.words, unit, to_internal, tolerance.amount, cause.kind)
            found.append(Factor(name, *stated, tolerance.distribution, cause.numbers))
    if not found:
        raise InputError("tolerances: all of them are 0: every part is as designed; raise one, or leave out the zeros")
    return tuple(found)


def read_tolerances(name: str) -> PartTolerances:
    """Tolerances of a preset, or of a TOML file with ``[tolerances]`` or tables of faces, such as a whole spec.

    Raises :class:`InputError` where there is neither.
    """
    if name in PRESET_AMOUNTS:
        return PartTolerances(preset=name)
    content = read_toml(Path(name), f"give {', '.join(PRESET_AMOUNTS)}, or a TOML file")
    try:
        content = with_new_names("Spec", content)
    except ValueError as error:
        raise InputError(f"{name}: {error}") from None
    lens = content.get("lens")
    faces = {face: lens[face] for face in DOUBLE if isinstance(lens, dict) and isinstance(lens.get(face), dict)}
    if "source" in content:  # a whole spec: its faces have more than tolerances
        known = FaceTolerances.model_fields
        faces = {face: {name: table[name] for name in table if name in known} for face, table in faces.items()}
    if not isinstance(section := content.get("tolerances", {} if any(faces.values()) else None), dict):
        raise InputError(f"{name}: has no [tolerances]; give {', '.join(PRESET_AMOUNTS)}, or a file that has")
    found = _validated(TolerancesSection, section, f"{name}: tolerances")
    own = {face: _validated(FaceTolerances, table, f"{name}: lens.{face}") for face, table in faces.items()}
    try:
        return PartTolerances.of(found, own)
    except InputError as error:
        raise InputError(str(error).replace(PartTolerances.__name__, f"{name}: lens", 1)) from None


_Table = TypeVar("_Table", bound=_Amounts)


def _validated(section: type[_Table], content: dict[str, Any], origin: str) -> _Table:
    try:
        return section.model_validate(content)
    except ValidationError as error:
        raise spec_error(error, origin, section) from None
