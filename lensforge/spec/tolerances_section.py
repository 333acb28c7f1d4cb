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
from functools import cache
from math import pi
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, get_args

from pydantic import BeforeValidator, Field

from lensforge.errors import InputError
from lensforge.optics.media import DOUBLE, REFLECTOR, SIDES, TIR
from lensforge.results.numerals import percent, quantity
from lensforge.spec.spec_files import read_toml
from lensforge.spec.spec_section import Section, check, section_of

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


# Faces with a place of their own against the first one; the others are cut as one with it.
_PLACED = {DOUBLE: ("outer",), TIR: ("wall", "exit"), REFLECTOR: ()}
PLACEMENT = ("shift_mm", "gap_mm", "tilt_deg")  # fields of such a face


def factor_name(face: str, field: str) -> str:
    """Name of the tolerance ``field`` of a ``face``; the usual lens has one gap."""
    return field if (face, field) == ("outer", "gap_mm") else f"{face}_{field}"


def _of_faces(names: tuple[str, ...], field: str, cause: _Cause) -> dict[str, _Cause]:
    """The tolerance ``field`` of each face, its words those of the ``cause`` and the face."""
    return {
        factor_name(face, field): cause._replace(words=f"{cause.words}, {face} face", face=face, field=field)
        for face in names
    }


def _placed(names: tuple[str, ...], field: str, cause: _Cause) -> dict[str, _Cause]:
    """A tolerance of the place of each face against the first one."""
    return {
        factor_name(face, field): cause._replace(
            words=f"{face} face against {names[0]}, {cause.words}", face=face, field=field
        )
        for face in _PLACED[names]
    }


@cache
def _causes(names: tuple[str, ...]) -> dict[str, _Cause]:
    """The tolerances of a lens with these faces in the order in which parts are drawn: their numbers depend on it."""
    surfaces = REFLECTOR[:1] if names == REFLECTOR else names  # its cup alone
    return {
        "source_shift_mm": _Cause("source, decentre", (0.02, 0.05, 0.05), 2),
        "source_height_mm": _Cause("source, height", (0.02, 0.05, 0.05)),
        "source_tilt_deg": _Cause("source, tilt", (0.2, 0.5, 0.5), 2),
        "source_flux": _Cause("source, flux", (0.05, 0.05, 0.05)),
        "source_size": _Cause("source, size", (0.01, 0.02, 0.02)),
        **_placed(names, "shift_mm", _Cause("decentre", (0.005, 0.02, 0.025), 2)),
        **_placed(names, "gap_mm", _Cause("gap", (0.005, 0.02, 0.025))),
        **_placed(names, "tilt_deg", _Cause("tilt", (0.02, 0.05, 0.05), 2)),
        "lens_shift_mm": _Cause("lens against source, decentre", (0.02, 0.05, 0.05), 2),
        "lens_height_mm": _Cause("lens against source, height", (0.01, 0.03, 0.05)),
        "lens_tilt_deg": _Cause("lens against source, tilt", (0.05, 0.1, 0.2), 2),
        **({} if names == REFLECTOR else {"index": _Cause("refractive index", (0.0005, 0.001, 0.001))}),
        "shrinkage": _Cause("shrinkage", (0.0, 0.0, 0.001)),
        **_of_faces(surfaces, "roughness_mrad", _Cause("roughness", (0.2, 0.5, 0.5), 1, "one-sided")),
        **_of_faces(surfaces, "ripple_um", _Cause("ripple", (0.01, 0.02, 0.0), 1, "one-sided")),
        **_of_faces(surfaces, "form_um", _Cause("form", (0.3, 1.0, 2.0), FORM_NUMBERS, "field")),
        **_of_faces(surfaces, "waviness_um", _Cause("waviness", (0.03, 0.1, 0.2), WAVINESS_NUMBERS, "field")),
    }


_PRESETS: tuple[TolerancePreset, ...] = get_args(TolerancePreset)
PRESET_AMOUNTS: dict[TolerancePreset, dict[str, float]] = {  # of the usual lens
    preset: {name: cause.amounts[number] for name, cause in _causes(DOUBLE).items()}
    for number, preset in enumerate(_PRESETS)
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

    @check
    def _has_a_width(self) -> None:
        if self.amount == 0.0 and "distribution" in self.model_fields_set:
            raise ValueError("amount = 0: a distribution has a width; raise it, or write 0 alone for an exact part")


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
    @check
    def _are_small(self) -> None:
        for name in type(self).model_fields:
            if not isinstance(tolerance := getattr(self, name), ToleranceSpec):
                continue
            if tolerance.amount > (most := _unit_of(name)[2]):
                raise ValueError(f"{name} = {tolerance.amount:g}: must be at most {most:g}")
            if name.endswith("_um") and "distribution" in tolerance.model_fields_set:
                words = "a face's error is Gaussian, and its amount the rms over all parts; leave out distribution"
                raise ValueError(f"{name}: {words}")


class FaceTolerances(_Amounts):
    """Tolerances of a face, and of its place against the first face: those left out come from the preset."""

    form_um: _Tolerance | None = None
    """Error of form as wide as astigmatism and coma, rms over parts and face."""
    waviness_um: _Tolerance | None = None
    """Finer errors of form, rms over parts and face."""
    ripple_um: _Tolerance | None = None
    """Rings of the cutter about the axis, peak to valley."""
    roughness_mrad: _Tolerance | None = None
    """Slope of the roughness along any line, rms."""
    shift_mm: _Tolerance | None = None
    """Shift of the face against the first one, in x and in y: of the outer face, of the wall, or of the exit."""
    gap_mm: _Tolerance | None = None
    """Shift of that face against the first one along z."""
    tilt_deg: _Tolerance | None = None
    """Tilt of that face against the first one, about x and about y."""


def refuse_placement(faces: Mapping[str, FaceTolerances]) -> None:
    """Raise ``ValueError`` where a face against which others are placed has a place of its own."""
    placed = _PLACED[tuple(faces)]
    for face, tolerances in faces.items():
        for name in PLACEMENT if face not in placed else ():
            if getattr(tolerances, name) is not None:
                other = f"what the next is placed against; give {placed[0]}.{name}" if placed else "alone; leave it out"
                raise ValueError(f"{face}.{name}: this face is {other}")


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

    @check
    def _band_is_a_band(self) -> None:
        if self.waviness_shortest_mm >= self.waviness_longest_mm:
            raise ValueError(
                f"waviness_shortest_mm = {self.waviness_shortest_mm:g}: must be below waviness_longest_mm = "
                f"{self.waviness_longest_mm:g}"
            )


class FacesTolerances(TolerancesSection):
    """All tolerances of a part: the ``[tolerances]`` of a spec, and those of its faces, whose ``names`` it has."""

    names: ClassVar[tuple[str, ...]] = ()

    @check
    def _first_is_the_reference(self) -> None:
        refuse_placement({name: getattr(self, name) for name in self.names})

    @classmethod
    def of(cls, section: TolerancesSection, faces: Mapping[str, FaceTolerances]) -> Self:
        """The tolerances of ``section`` with those in the tables of the ``faces``."""
        fields = FaceTolerances.model_fields
        own = {name: FaceTolerances(**{each: getattr(face, each) for each in fields}) for name, face in faces.items()}
        return cls(**{**section.model_dump(exclude_unset=True), **own})

    def given(self, name: str) -> ToleranceSpec | None:
        """The tolerance of the factor ``name`` where it is given; None for that of the preset."""
        cause = _causes(self.names)[name]
        holder = self if cause.face is None else getattr(self, cause.face)
        found: ToleranceSpec | None = getattr(holder, cause.field or name)
        return found

    def tolerance(self, name: str) -> ToleranceSpec:
        """The tolerance of the factor ``name``: as given, or that of the preset."""
        amounts = _causes(self.names)[name].amounts
        return self.given(name) or ToleranceSpec(amount=amounts[_PRESETS.index(self.preset)])

    def amount(self, face: str, field: str) -> float:
        """Amount of the tolerance ``field`` of a ``face``; 0 of a place that it has not."""
        name = factor_name(face, field)
        return self.tolerance(name).amount if name in _causes(self.names) else 0.0


class PartTolerances(FacesTolerances):
    """All tolerances of a part: the ``[tolerances]`` of a spec, and those of its faces."""

    names = DOUBLE

    inner: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the inner face."""
    outer: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the outer face, and of its place against the inner one."""


class TirTolerances(FacesTolerances):
    """All tolerances of a part for total internal reflection. The cap and the side of its cavity are cut as one."""

    names = TIR

    cap: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the cap."""
    side: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the side."""
    wall: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the wall, and of its place against the cavity."""
    exit: FaceTolerances = Field(default_factory=FaceTolerances)
    """Those of the exit, and of its place against the cavity."""


class ReflectorTolerances(FacesTolerances):
    """All tolerances of a reflector: those of its cup. No light meets its back, and its mouth is no surface."""

    names = REFLECTOR
    cup: FaceTolerances = Field(default_factory=FaceTolerances)
    back: FaceTolerances = Field(default_factory=FaceTolerances)
    mouth: FaceTolerances = Field(default_factory=FaceTolerances)


def tolerances_with(names: tuple[str, ...]) -> type[FacesTolerances]:
    """The class of all tolerances of a lens with faces of these ``names``."""
    return next(kind for kind in FacesTolerances.__subclasses__() if kind.names == names)


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


def factors_of(tolerances: FacesTolerances) -> tuple[Factor, ...]:
    """All ``tolerances`` that are not 0. Raises :class:`InputError` where all are 0."""
    found = []
    for name, cause in _causes(tolerances.names).items():
        own, (unit, to_internal, _) = tolerances.tolerance(name), _unit_of(name)
        stated = (cause.words, unit, to_internal, own.amount, cause.kind, own.distribution, cause.numbers)
        found += [Factor(name, *stated)] if own.amount > 0.0 else []
    if not found:
        raise InputError("tolerances: all of them are 0: every part is as designed; raise one, or leave out the zeros")
    return tuple(found)


def read_tolerances(name: str, names: tuple[str, ...] = DOUBLE) -> FacesTolerances:
    """Tolerances of a preset, or of a TOML file with ``[tolerances]`` or tables of faces, such as a whole spec.

    ``names``: of the faces of the lens. Raises :class:`InputError` where there is neither, and for other faces.
    """
    own_kind = tolerances_with(names)
    if name in PRESET_AMOUNTS:
        return own_kind(preset=name)
    content = read_toml(Path(name), f"give {', '.join(PRESET_AMOUNTS)}, or a TOML file")
    lens = content.get("lens")
    faces = {face: lens[face] for face in SIDES if isinstance(lens, dict) and isinstance(lens.get(face), dict)}
    if "source" in content:  # a whole spec: its faces have more than tolerances
        known = FaceTolerances.model_fields
        faces = {face: {name: table[name] for name in table if name in known} for face, table in faces.items()}
    for face in faces:
        if face not in names:
            raise InputError(f"{name}: lens.{face}: the faces of this lens are {', '.join(names)}; give these")
    if not isinstance(section := content.get("tolerances", {} if any(faces.values()) else None), dict):
        raise InputError(f"{name}: has no [tolerances]; give {', '.join(PRESET_AMOUNTS)}, or a file that has")
    found = section_of(TolerancesSection, section, f"{name}: tolerances")
    own = {face: section_of(FaceTolerances, table, f"{name}: lens.{face}") for face, table in faces.items()}
    try:
        return own_kind.of(found, own)
    except InputError as error:
        raise InputError(str(error).replace(own_kind.__name__, f"{name}: lens", 1)) from None
