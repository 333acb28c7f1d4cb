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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer

from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY, SHELL, FaceRole
from lensforge.public import public
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

    phrase: str
    amounts: tuple[float, float, float]
    numbers: int = 1
    kind: FactorKind = "spread"
    face: str | None = None
    field: str = ""


PLACEMENT = ("shift_mm", "gap_mm", "tilt_deg")  # fields of a face with a place of its own against the first one


def _placed_faces(roles: Sequence[FaceRole]) -> list[str]:
    return [role.name for role in roles if role.is_placed]


def factor_name(roles: Sequence[FaceRole], face: str, field: str) -> str:
    """Name of the tolerance ``field`` of a ``face``; a lens with one face that is placed has one gap."""
    return field if field == "gap_mm" and _placed_faces(roles) == [face] else f"{face}_{field}"


@cache
def _causes(roles: tuple[FaceRole, ...]) -> dict[str, _Cause]:
    """The tolerances of a lens with these faces in the order in which parts are drawn: their numbers depend on it."""

    def of_faces(names: Sequence[str], description: str, field: str, cause: _Cause) -> dict[str, _Cause]:
        return {
            factor_name(roles, face, field): cause._replace(
                phrase=description.format(cause=cause.phrase, face=face), face=face, field=field
            )
            for face in names
        }

    opaque = not lets_light_in(roles)  # no light meets what bounds the body outwards
    lit = [role.name for role in roles if not (role.is_open or (opaque and role.before == BODY))]
    placed = partial(of_faces, _placed_faces(roles), f"{{face}} face against {roles[0].name}, {{cause}}")
    shape = partial(of_faces, lit, "{cause}, {face} face")
    return {
        "source_shift_mm": _Cause("source, decentre", (0.02, 0.05, 0.05), 2),
        "source_height_mm": _Cause("source, height", (0.02, 0.05, 0.05)),
        "source_tilt_deg": _Cause("source, tilt", (0.2, 0.5, 0.5), 2),
        "source_flux": _Cause("source, flux", (0.05, 0.05, 0.05)),
        "source_size": _Cause("source, size", (0.01, 0.02, 0.02)),
        **placed("shift_mm", _Cause("decentre", (0.005, 0.02, 0.025), 2)),
        **placed("gap_mm", _Cause("gap", (0.005, 0.02, 0.025))),
        **placed("tilt_deg", _Cause("tilt", (0.02, 0.05, 0.05), 2)),
        "lens_shift_mm": _Cause("lens against source, decentre", (0.02, 0.05, 0.05), 2),
        "lens_height_mm": _Cause("lens against source, height", (0.01, 0.03, 0.05)),
        "lens_tilt_deg": _Cause("lens against source, tilt", (0.05, 0.1, 0.2), 2),
        **({} if opaque else {"index": _Cause("refractive index", (0.0005, 0.001, 0.001))}),
        "shrinkage": _Cause("shrinkage", (0.0, 0.0, 0.001)),
        "temperature_k": _Cause("temperature of the lens", (0.0, 0.0, 0.0)),
        **shape("roughness_mrad", _Cause("roughness", (0.2, 0.5, 0.5), 1, "one-sided")),
        **shape("ripple_um", _Cause("ripple", (0.01, 0.02, 0.0), 1, "one-sided")),
        **shape("form_um", _Cause("form", (0.3, 1.0, 2.0), FORM_NUMBERS, "field")),
        **shape("waviness_um", _Cause("waviness", (0.03, 0.1, 0.2), WAVINESS_NUMBERS, "field")),
    }


_PRESETS: tuple[TolerancePreset, ...] = get_args(TolerancePreset)


Distribution = Literal["uniform", "normal", "truncated"]


@public
class ToleranceSpec(Section):
    """One tolerance, and how parts are spread over it."""

    amount: Annotated[float, Field(ge=0.0)] = Field(description="Amount either way, in the unit of the tolerance.")
    distribution: Distribution = Field(
        default="truncated",
        description='Spread: "uniform", anywhere within the amount; "normal", Gaussian, 95 % of the parts within '
        'it (its standard deviation is half the amount); "truncated", the same without the parts '
        "beyond it, which inspection has sorted out.",
    )

    @check
    def _has_a_width(self) -> None:
        if self.amount == 0.0 and "distribution" in self.model_fields_set:
            raise ValueError("amount = 0: a distribution has a width; raise it, or write 0 alone for an exact part")

    @model_serializer(mode="wrap")
    def _as_given(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        """The record without a distribution that was not given: an amount of 0 and a face's error may have none."""
        return {name: value for name, value in write(self).items() if name in self.model_fields_set}


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
    "_k": ("K", 1.0, 200.0),
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


@public
class _Amounts(Section):
    @check
    def _are_small(self) -> None:
        for name in type(self).model_fields:
            if not isinstance(tolerance := getattr(self, name), ToleranceSpec):
                continue
            if tolerance.amount > (most := _unit_of(name)[2]):
                raise ValueError(f"{name} = {tolerance.amount:g}: must be at most {most:g}")
            if name.endswith("_um") and "distribution" in tolerance.model_fields_set:
                advice = "a face's error is Gaussian, and its amount the rms over all parts; leave out distribution"
                raise ValueError(f"{name}: {advice}")


@public
class FaceTolerances(_Amounts):
    """Tolerances of a face, and of its place against the first face: those left out come from the preset."""

    form_um: _Tolerance | None = Field(
        default=None, description="Error of form as wide as astigmatism and coma, rms over parts and face."
    )
    waviness_um: _Tolerance | None = Field(default=None, description="Finer errors of form, rms over parts and face.")
    ripple_um: _Tolerance | None = Field(
        default=None, description="Rings of the cutter about the axis, peak to valley."
    )
    roughness_mrad: _Tolerance | None = Field(default=None, description="Slope of the roughness along any line, rms.")
    shift_mm: _Tolerance | None = Field(
        default=None,
        description="Shift of the face against the first one, in x and in y: of the outer face, of the wall, or "
        "of the exit.",
    )
    gap_mm: _Tolerance | None = Field(default=None, description="Shift of that face against the first one along z.")
    tilt_deg: _Tolerance | None = Field(
        default=None, description="Tilt of that face against the first one, about x and about y."
    )


def lets_light_in(roles: Sequence[FaceRole]) -> bool:
    """True where light enters the body by a face of its cavity; False of a reflector."""
    return any(role.before == CAVITY and not (role.is_open or role.reflects) for role in roles)


def refuse_placement(roles: Sequence[FaceRole], faces: Mapping[str, FaceTolerances]) -> None:
    """Raise ``ValueError`` where a face against which others are placed has a place of its own."""
    placed = _placed_faces(roles)
    for role in roles:
        for name in PLACEMENT if role.name in faces and not role.is_placed else ():
            if getattr(faces[role.name], name) is not None:
                advice = (
                    f"what the next is placed against; give {placed[0]}.{name}" if placed else "alone; leave it out"
                )
                raise ValueError(f"{role.name}.{name}: this face is {advice}")


@public
class TolerancesSection(_Amounts):
    """Tolerances: a number, or ``{ amount = 0.05, distribution = "normal" }``; 0 for none.

    Those of a face stand in its own table, such as ``lens.outer.gap_mm``. What is left out comes from ``preset``.
    Roughness and ripple are between none and their amount; the shapes of form and waviness are drawn anew for every
    part.
    """

    preset: TolerancePreset = Field(
        default="standard", description="Amounts of the tolerances that are left out (docs/definitions.md, section 16)."
    )
    source_shift_mm: _Tolerance | None = Field(
        default=None, description="Shift of the LED against its place in the spec, in x and in y."
    )
    source_height_mm: _Tolerance | None = Field(default=None, description="Shift of the LED along z.")
    source_tilt_deg: _Tolerance | None = Field(default=None, description="Tilt of the LED about x and about y.")
    source_flux: _Tolerance | None = Field(default=None, description="Error of the LED's flux, as a share.")
    source_size: _Tolerance | None = Field(default=None, description="Error of the LED's size, as a share.")
    lens_shift_mm: _Tolerance | None = Field(
        default=None, description="Shift of the whole lens against LED and receivers, in x and in y."
    )
    lens_height_mm: _Tolerance | None = Field(default=None, description="Shift of the whole lens along z.")
    lens_tilt_deg: _Tolerance | None = Field(default=None, description="Tilt of the whole lens about x and about y.")
    index: _Tolerance | None = Field(default=None, description="Error of the index, of the batch.")
    shrinkage: _Tolerance | None = Field(default=None, description="Change of all lengths, as a share.")
    temperature_k: _Tolerance | None = Field(
        default=None, description="Temperature of the lens against that at which it is at work: index and size follow."
    )
    waviness_shortest_mm: Annotated[float, Field(ge=0.01, le=100.0)] = Field(
        default=0.5, description="Shortest period of the waviness."
    )
    waviness_longest_mm: Annotated[float, Field(ge=0.01, le=100.0)] = Field(
        default=5.0, description="Longest period of the waviness."
    )
    ripple_period_mm: Annotated[float, Field(ge=1e-3, le=10.0)] = Field(
        default=0.1, description="Distance of the rings that the cutter leaves about the axis."
    )

    @check
    def _band_is_a_band(self) -> None:
        if self.waviness_shortest_mm >= self.waviness_longest_mm:
            raise ValueError(
                f"waviness_shortest_mm = {self.waviness_shortest_mm:g}: must be below waviness_longest_mm = "
                f"{self.waviness_longest_mm:g}"
            )


@public
class PartTolerances(TolerancesSection):
    """All tolerances of a part: the ``[tolerances]`` of a spec, and those of its ``faces`` by their names."""

    faces: dict[str, FaceTolerances] = Field(
        default_factory=dict, description="Tolerances of faces; those of a face that is left out come from the preset."
    )
    roles: tuple[FaceRole, ...] = Field(
        default=SHELL, exclude=True, description="The faces of the lens, once it is known; till then two."
    )

    @check
    def _first_is_the_reference(self) -> None:
        refuse_placement(self.roles, self.faces)

    @staticmethod
    def of(
        section: TolerancesSection, faces: Mapping[str, FaceTolerances], roles: tuple[FaceRole, ...]
    ) -> "PartTolerances":
        """The tolerances of ``section``, with those that the tables of the ``faces`` give, of a lens of these faces.

        Raises :class:`InputError` where it has other faces.
        """
        fields = FaceTolerances.model_fields
        given = {
            name: FaceTolerances(**{field: value for field in fields if (value := getattr(face, field)) is not None})
            for name, face in faces.items()
        }
        of_faces = {name: face for name, face in given.items() if face.model_fields_set}
        names = [role.name for role in roles]
        if not set(of_faces) <= set(names):
            raise InputError(
                f"tolerances of the faces {', '.join(of_faces)}: this lens has {', '.join(names)}; "
                "give those of its faces"
            )
        kept = section.model_dump(exclude_unset=True, exclude={"faces"})
        return PartTolerances(**kept, faces=of_faces, roles=roles)

    def given(self, name: str) -> ToleranceSpec | None:
        """The tolerance of the factor ``name`` where it is given; None for that of the preset."""
        cause = _causes(self.roles)[name]
        holder = self if cause.face is None else self.faces.get(cause.face)
        return getattr(holder, cause.field or name, None)

    def tolerance(self, name: str) -> ToleranceSpec:
        """The tolerance of the factor ``name``: as given, or that of the preset."""
        return self.given(name) or ToleranceSpec(amount=amounts_of(self.preset, self.roles)[name])

    def amount(self, face: str, field: str) -> float:
        """Amount of the tolerance ``field`` of a ``face``; 0 of a place that it has not."""
        name = factor_name(self.roles, face, field)
        return self.tolerance(name).amount if name in _causes(self.roles) else 0.0


def amounts_of(preset: TolerancePreset, roles: tuple[FaceRole, ...] = SHELL) -> dict[str, float]:
    """Amounts of all tolerances of a preset for a lens with these faces, by the names of their factors."""
    return {name: cause.amounts[_PRESETS.index(preset)] for name, cause in _causes(roles).items()}


@dataclass(frozen=True)
class Factor:
    """One tolerance as a cause of its own, drawn for every part: ``amount`` in ``unit``, ``to_internal`` mm, rad or 1.

    ``kind``: "spread" to both sides by ``distribution``; "one-sided", from none to the amount; or the "field" of a
    form error, whose ``numbers`` are Gaussian and make up its shape. ``numbers``: drawn for each part.
    """

    name: str
    phrase: str
    unit: str
    to_internal: float
    amount: float
    kind: FactorKind
    distribution: Distribution
    numbers: int


def factors_of(tolerances: PartTolerances) -> tuple[Factor, ...]:
    """All ``tolerances`` that are not 0. Raises :class:`InputError` where all are 0."""
    factors = []
    for name, cause in _causes(tolerances.roles).items():
        tolerance = tolerances.tolerance(name)
        (unit, to_internal, _) = _unit_of(name)
        stated = (cause.phrase, unit, to_internal, tolerance.amount, cause.kind, tolerance.distribution, cause.numbers)
        factors += [Factor(name, *stated)] if tolerance.amount > 0.0 else []
    if not factors:
        raise InputError("tolerances: all of them are 0: every part is as designed; raise one, or leave out the zeros")
    return tuple(factors)


def read_tolerances(name: str, roles: tuple[FaceRole, ...] = SHELL) -> PartTolerances:
    """Tolerances of a preset, or of a TOML file with ``[tolerances]`` or tables of faces, such as a whole spec.

    ``roles``: of the faces of the lens. Raises :class:`InputError` where there is neither, and for other faces.
    """
    if name in _PRESETS:
        return PartTolerances(preset=name, roles=roles)
    content = read_toml(Path(name), f"give {', '.join(_PRESETS)}, or a TOML file")
    faces = _faces_in(content)
    names = [role.name for role in roles]
    for face in faces:
        if face not in names:
            raise InputError(f"{name}: lens.{face}: the faces of this lens are {', '.join(names)}; give these")
    if not isinstance(section := content.get("tolerances", {} if any(faces.values()) else None), dict):
        raise InputError(f"{name}: has no [tolerances]; give {', '.join(_PRESETS)}, or a file that has")
    section_read = section_of(TolerancesSection, section, f"{name}: tolerances")
    of_faces = {face: section_of(FaceTolerances, table, f"{name}: lens.{face}") for face, table in faces.items()}
    try:
        return PartTolerances.of(section_read, of_faces, roles)
    except InputError as error:
        raise InputError(str(error).replace(PartTolerances.__name__, f"{name}: lens", 1)) from None


def _faces_in(content: Mapping[str, Any]) -> dict[str, dict[str, object]]:
    """The tables of faces in a TOML file: all of its ``[lens]``, or of a whole spec the tolerances that they have."""
    lens = content.get("lens")
    tables = {face: table for face, table in lens.items() if isinstance(table, dict)} if isinstance(lens, dict) else {}
    if "source" not in content:
        return tables
    known = FaceTolerances.model_fields
    given = {face: {field: table[field] for field in table if field in known} for face, table in tables.items()}
    return {face: table for face, table in given.items() if table}
