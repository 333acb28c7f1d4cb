"""The lens: two frozen surfaces, the spec that they were designed for, and the settings of the design.

The design stage makes it, the geometry stage builds the part from it; NumPy only. ``lens.json`` holds all of it. Where
lamps have lenses of several kinds by place, it is one of them, and has the faces of the others beside its own.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, JsonValue

from lensforge.errors import InputError, WrongFields
from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.material import Material
from lensforge.optics.media import Media
from lensforge.public import public, with_shown_types
from lensforge.results import Count, Record, Text
from lensforge.results.arguments import with_known_names
from lensforge.results.files import json_in, read_json_bytes, write_json
from lensforge.results.notebook_html import section_html, table_text
from lensforge.results.stage_result import CHECKSUM, require_checksum, validated, with_checksum, without_schema
from lensforge.scene.body import Body, radii
from lensforge.spec import AnyAccuracy, Spec, parse_spec
from lensforge.spec.accuracy import stated
from lensforge.spec.search_section import LARGEST
from lensforge.surfaces.drawn_profile import in_section
from lensforge.surfaces.mirror_group import shared_symmetry
from lensforge.surfaces.placed_bodies import has_mirrors
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface, SurfaceRecord, surface_record
from lensforge.version import __version__

SCHEMA = "lensforge-lens-3"
_REMEDY = "run `lensforge design` again"
_WORDS = {"Asphere": "asphere", "Biconic": "biconic"}
_DIRECTIONS = 200


@public
@dataclass(frozen=True, eq=False)
class Lens:
    """A body of named surfaces, freeform or fixed: of the double lens ``inner`` and ``outer``.

    Of lamps with lenses of several kinds it is that of the first of ``kinds``; all else that takes one lens, takes
    that one. The light is that of all.

    Fields:
        surfaces (mapping of str to Surface): By name, in order from the source on; lengths in mm.
        spec (Spec): By which it was designed.
        seed (int): Of its search.
        accuracy ('draft' or 'standard' or 'reference' or Preset): Preset of its search, and of the stages after
            it.
        version (str): Of the program that designed it.
        others (mapping of str to mapping of str to Surface): Surfaces of the further kinds, by name.
    """

    surfaces: Mapping[str, Surface]
    spec: Spec
    seed: int
    accuracy: AnyAccuracy
    version: str = __version__
    others: Mapping[str, Mapping[str, Surface]] = field(default_factory=dict)

    @staticmethod
    @with_shown_types
    def double(
        inner: Surface, outer: Surface, spec: Spec, seed: int, accuracy: AnyAccuracy, version: str = __version__
    ) -> "Lens":
        """Make a double-freeform lens: ``inner`` faces the source, ``outer`` the target."""
        return Lens({"inner": inner, "outer": outer}, spec, seed, accuracy, version)

    @property
    def kind(self) -> str:
        """Name of its kind, of several; empty if all lamps have the same lens."""
        return next((kind.name for kind in self.spec.all_lamps.kinds if kind.name not in self.others), "")

    @property
    def kinds(self) -> "tuple[Lens, ...]":
        """Lens of each kind in the order of ``spec.all_lamps``, each with the others behind it; itself for one."""
        return tuple(map(self.of_kind, (kind.name for kind in self.spec.all_lamps.kinds))) or (self,)

    def of_kind(self, name: str) -> "Lens":
        """Select the lens of the kind ``name``, with the others behind it. Raises :class:`InputError` for no such."""
        every = {self.kind: self.surfaces, **self.others}
        if name not in every:
            known = ", ".join(repr(kind.name) for kind in self.spec.all_lamps.kinds) or "none, all lamps have one lens"
            raise InputError(f"kind = {name!r}: no lens of that name; known: {known}")
        return self if name == self.kind else replace(self, surfaces=every.pop(name), others=every)

    @property
    def by_state(self) -> "dict[str, Lens]":
        """Lens in each of its states alone, by name; "" is the name of the only one."""
        if not self.spec.all_states:
            return {"": self}
        return {name: replace(self, spec=spec) for name, spec in self.spec.by_state.items()}

    def of_state(self, name: str) -> "Lens":
        """Lens in the state ``name`` alone; itself for "". Raises :class:`InputError` where there is no such state."""
        return replace(self, spec=self.spec.of_state(name)) if name else self

    @property
    def first_lamp(self) -> int:
        """Number of the first of the lamps that have this lens."""
        return next((kind.numbers[0] for kind in self.spec.all_lamps.kinds if kind.name == self.kind), 0)

    @property
    def lamp_words(self) -> str:
        """Words on the one of several lamps whose rays are followed one by one; empty if there is one alone."""
        lamps = self.spec.all_lamps
        kind = f" with the lens {self.kind}" if self.kind else ""
        if not lamps.posed:
            return "" if lamps.is_single else f"of one lamp{kind}, at the origin"
        return f"of lamp {self.first_lamp + 1} of {len(lamps)}{kind}, with the receivers as it sees them"

    @property
    def own_lamps_words(self) -> str:
        """Words on all lamps that have this lens, whose light is told together; empty if there is one alone."""
        apart = ", each apart from its plate" if self.spec.plate is not None and not self.makes_plate else ""
        return self.of_own_lamps.spec.all_lamps.whole + (f" with the lens {self.kind}" if self.kind else "") + apart

    @property
    def makes_plate(self) -> bool:
        """True where a plate is made with this lens: with the first of several kinds, whose lenses it has all."""
        return self.spec.plate is not None and self.kinds[0] is self

    @property
    def lamps_on_plate(self) -> bool:
        """True where the plate that is made with it has all lamps; of an endless lattice it has some."""
        return self.makes_plate and self.spec.all_lamps.period_mm is None

    @property
    def of_own_lamps(self) -> "Lens":
        """This lens with those lamps alone that have it: itself, where all have."""
        kind = next((kind for kind in self.spec.all_lamps.kinds if kind.name == self.kind), None)
        if kind is None or self.spec.lamps is None:
            return self
        apart = {"lamps": self.spec.lamps.of_numbers(kind.numbers), "plate": None, "base": self.spec.base_made}
        return replace(self, spec=self.spec.changed(**apart), others={})

    @cached_property
    def body(self) -> Body:
        """Faces, and the media between them."""
        return Body.of(self.surfaces, self.spec.lens.body_roles)

    @property
    def events(self) -> int:
        """Largest number of faces that a ray meets."""
        return self.spec.lens.most_events

    @property
    def inner(self) -> Surface:
        """Surface that faces the source."""
        return self.surfaces["inner"]

    @property
    def outer(self) -> Surface:
        """Surface that faces the target."""
        return self.surfaces["outer"]

    @property
    def refractive_index(self) -> float:
        """Index of the body at the design wavelength."""
        return self.spec.lens.refractive_index

    @property
    def media(self) -> Media:
        """Body at the design wavelength, what fills the cavity and surrounds the lens, and the bodies behind it."""
        return self.spec.media

    @property
    def dispersion(self) -> Material | None:
        """Index of the body against wavelength; None for one index."""
        return self.spec.lens.dispersion

    @property
    def basis(self) -> SrbfBasis:
        """Radial basis functions of the spec: they shape the free surfaces, and the form errors of both."""
        return self.spec.lens.basis

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature of all surfaces, which a common table must resolve."""
        return min(surface.detail_rad for surface in self.surfaces.values())

    def directions(self, count: int) -> Float[np.ndarray, "n 3"]:
        """``count`` unit directions in which its size is measured: of faces that are drawn along y in their section."""
        if self.spec.lens.drawn_mm is None:
            return fibonacci_hemisphere(count)
        return in_section(np.linspace(-0.5 * np.pi, 0.5 * np.pi, count))

    @property
    def symmetry(self) -> str:
        """Largest mirror group of all surfaces and of the bodies behind them, a name of ``surfaces.mirror_group``."""
        symmetries = [surface.symmetry for surface in self.surfaces.values()]
        bodies = self.media.bodies
        return shared_symmetry(symmetries, lambda name: all(has_mirrors(body, name) for body in bodies))

    def to_json(self) -> dict[str, JsonValue]:
        """Content of ``lens.json``, all digits of every weight."""
        return {
            "schema": SCHEMA,
            "version": self.version,
            "seed": self.seed,
            "accuracy": stated(self.accuracy),
            "units": {"length": "mm", "angle": "rad"},
            "faces": _faces_record(self.surfaces),
            **({"others": {kind: _faces_record(faces) for kind, faces in self.others.items()}} if self.others else {}),
            "spec": self.spec.model_dump(mode="json"),
        }

    @cached_property
    def sha256(self) -> str:
        """Hash of the lens; results state it to name the lens that they belong to."""
        return _sha256_of(self.to_json())

    def __eq__(self, other: object) -> bool:
        """True where ``other`` is the same lens, bit for bit."""
        return self.to_json() == other.to_json() if isinstance(other, Lens) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)

    def save(self, path: Path | str) -> None:
        """Write ``lens.json``, with the hash of its content; weights are written with all digits."""
        write_json(Path(path), with_checksum(self.to_json()))

    def _identity(self) -> dict[str, str]:
        spec = self.spec
        return {
            "material": f"{spec.lens.material}, n = {self.refractive_index:g}",
            "source": spec.source.title,
            "receiver": "; ".join(receiver.title for receiver in spec.all_receivers),
            "surfaces": ", ".join(f"{name}: {_describe(surface)}" for name, surface in self.surfaces.items()),
            "made by": f"lensforge {self.version}, {self.accuracy}, seed {self.seed}",
        }

    def __repr__(self) -> str:
        return table_text(f"Lens {self.spec.name}", self._identity())

    def _repr_html_(self) -> str:
        """HTML for a notebook: a section at y = 0, and the facts that identify the lens."""
        theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
        u = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=1)
        outer, inner = (
            radii(faces, u).min(axis=0)[:, None] * u[:, [0, 2]] for faces in (self.body.envelope, self.body.cavity)
        )
        return section_html(self.spec.name, np.concatenate([outer, inner[::-1]]), self._identity())


def _faces_record(surfaces: Mapping[str, Surface]) -> dict[str, JsonValue]:
    return {name: surface_record(surface).model_dump(mode="json") for name, surface in surfaces.items()}


def _describe(surface: Surface) -> str:
    if isinstance(surface, SrbfSurface):
        basis = surface.basis
        return f"{basis.size} functions in {len(basis.levels)} levels, symmetry {basis.symmetry}"
    return f"fixed, {_WORDS.get(type(surface).__name__, 'given')}"


@public
@with_known_names
def load_lens(path: Path | str) -> Lens:
    """Read what :meth:`Lens.save` wrote.

    Args:
        path: the file; one that another program writes may leave out the hash of its content.
    Returns: The lens.
    Raises: :class:`InputError` for any other file, and for one of an earlier version.
    Example:
        >>> lens = lf.load_lens("cad_out/quickstart/lens.json")
        >>> print(lens.refractive_index, list(lens.surfaces))
    """
    path = Path(path)
    return _lens_in(read_json_bytes(path), path)


@lru_cache(maxsize=4)  # a command reads its lens at every stage; the tables of its basis take half a second
def _lens_in(file: bytes, path: Path) -> Lens:
    content = json_in(file, path)
    hashed = content if isinstance(content, dict) and CHECKSUM in content else None
    if isinstance(content, dict):
        content = {key: value for key, value in content.items() if key != CHECKSUM}
    record = validated(LensRecord, without_schema(content, SCHEMA, path, _REMEDY), path, _REMEDY)
    try:
        spec = parse_spec(record.spec, str(path))
    except WrongFields as error:  # nobody wrote this spec: the first field says as much as all
        raise InputError(f"{error.lines[0]}; {_REMEDY}") from None
    if spec.lens.levels == "auto":
        raise InputError(f'{path}: spec.lens.levels = "auto", must be the numbers of its lens; {_REMEDY}')
    try:
        surfaces = _faces_in(record.faces, spec)
        further = {k: _faces_in(faces, spec) for k, faces in record.others.items()}
        _require_kinds(spec, surfaces, further)
    except InputError as error:
        raise InputError(f"{path}: {error}; {_REMEDY}") from None
    if hashed is not None:
        require_checksum(hashed, path, _REMEDY)
    lens = Lens(surfaces, spec, record.seed, record.accuracy, record.version, further)
    # Results name the lens by its file. One of an earlier version lacks fields that a spec has got since: hashed with
    # these, it would be another lens, and all its results out of date.
    vars(lens)["sha256"] = _sha256_of(content)
    return lens


def _sha256_of(content: Mapping[str, JsonValue]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _faces_in(record: Mapping[str, SurfaceRecord], spec: Spec) -> dict[str, Surface]:
    surfaces: dict[str, Surface] = {name: face.surface() for name, face in record.items()}
    for name, surface in surfaces.items():
        _require_size(name, surface, LARGEST * spec.constraints.max_radius_mm)
    return surfaces


def _require_kinds(spec: Spec, first: Mapping[str, Surface], further: Mapping[str, Mapping[str, Surface]]) -> None:
    names = {kind.name for kind in spec.all_lamps.kinds}
    if not (set(further) <= names and len(further) == max(0, len(names) - 1)):
        raise InputError(f"others: lenses {sorted(further)}, must be all but one of the kinds {sorted(names)}")
    if any(list(faces) != list(first) for faces in further.values()):
        raise InputError(f"others: the lens of each kind must have the faces {', '.join(first)}")


def _require_size(name: str, surface: Surface, most_mm: float) -> None:
    """Raise :class:`InputError` where a surface meets the origin, or is larger than any lens of its spec."""
    radius = surface.radius(fibonacci_hemisphere(_DIRECTIONS))
    if not (radius.min() > 0.0 and radius.max() <= most_mm):
        raise InputError(
            f"{name}: {radius.min():.4g} to {radius.max():.4g} mm from the origin, must be above 0 and at most "
            f"{most_mm:.4g}, ten times constraints.max_radius_mm"
        )


class LensUnits(Record):
    """Units of all numbers in the file."""

    length: Literal["mm"]
    angle: Literal["rad"]


class LensRecord(Record):
    """``lens.json`` without the name of its schema; the spec is validated by :func:`parse_spec`."""

    unions = (*DOUBLE, "accuracy")

    version: Text
    seed: Count
    accuracy: AnyAccuracy
    units: LensUnits
    faces: dict[str, SurfaceRecord]
    others: Annotated[dict[Text, dict[str, SurfaceRecord]], Field(default_factory=dict)]
    spec: dict[str, object]
