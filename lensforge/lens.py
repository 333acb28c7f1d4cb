"""The record where the two stages meet: two frozen surfaces, the spec they serve, and how they came to be.

The design stage writes it, the geometry stage reads it; NumPy only. ``lens.json`` holds all of it.
"""

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path

import numpy as np
from pydantic import JsonValue, ValidationError

from lensforge.errors import InputError
from lensforge.files import read_json, write_json
from lensforge.lens_file import EARLIER_FORMAT, SCHEMA, LensRecord, record_of
from lensforge.records.record import refused
from lensforge.records.stored import reject_outdated
from lensforge.spec import Accuracy, Spec, parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface
from lensforge.version import __version__

_REMEDY = "run `lensforge design` again"


@dataclass(frozen=True, eq=False)
class Lens:
    """Two surfaces, one of them perhaps fixed: ``inner`` faces the source, ``outer`` the target; lengths in mm."""

    inner: Surface
    outer: Surface
    spec: Spec
    seed: int
    accuracy: Accuracy
    version: str = __version__

    @property
    def refractive_index(self) -> float:
        """Index of the body at the design wavelength; the surroundings are air, n = 1."""
        return self.spec.lens.refractive_index

    @property
    def basis(self) -> SrbfBasis:
        """The functions that shape what is free of the lens; errors of either surface are described by them, too."""
        return self.spec.lens.basis

    @property
    def detail_rad(self) -> float:
        """Of the narrowest feature of both surfaces, the sigma (rad) that a common table must resolve."""
        return min(self.inner.detail_rad, self.outer.detail_rad)

    def to_json(self) -> dict[str, JsonValue]:
        """The content of ``lens.json``, all digits of every weight."""
        return {
            "schema": SCHEMA,
            "version": self.version,
            "seed": self.seed,
            "accuracy": self.accuracy,
            "units": {"length": "mm", "angle": "rad"},
            "inner": record_of(self.inner).model_dump(mode="json"),
            "outer": record_of(self.outer).model_dump(mode="json"),
            "spec": self.spec.model_dump(mode="json"),
        }

    @cached_property
    def sha256(self) -> str:
        """The lens's own hash, by which a result names the lens that it belongs to."""
        return hashlib.sha256(json.dumps(self.to_json(), sort_keys=True).encode()).hexdigest()

    def __eq__(self, other: object) -> bool:
        """Whether ``other`` is the same lens, to the bit."""
        return self.to_json() == other.to_json() if isinstance(other, Lens) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)

    def save(self, path: Path | str) -> None:
        """Write ``lens.json``; weights are written with all of their digits."""
        write_json(Path(path), self.to_json())

    def _repr_html_(self) -> str:
        """What a notebook shows: a section at y = 0, and the numbers that name the lens."""
        spec = self.spec
        rows = {
            "material": f"{spec.lens.material}, n = {self.refractive_index:g}",
            "source": spec.source.title,
            "receiver": f"{spec.target.receiver_mm:g} mm wide at {spec.target.distance_mm:g} mm",
            "surfaces": ", ".join(f"{name}: {_describe(getattr(self, name))}" for name in ("inner", "outer")),
            "made by": f"lensforge {self.version}, {self.accuracy}, seed {self.seed}",
        }
        table = "".join(f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
        return f"<div><strong>{escape(spec.name)}</strong>{_section_svg(self)}<table>{table}</table></div>"


def _section_svg(lens: Lens) -> str:
    """The body cut at y = 0, in the colour of the text around it."""
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    u = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=1)
    outer, inner = (surface.radius(u)[:, None] * u[:, [0, 2]] * (1.0, -1.0) for surface in (lens.outer, lens.inner))
    reach = 1.05 * float(np.abs(outer).max())
    points = " ".join(f"{x:.4g},{y:.4g}" for x, y in np.concatenate([outer, inner[::-1]]))
    return (
        f'<svg role="img" aria-label="section" viewBox="{-reach:.4g} {-reach:.4g} {2 * reach:.4g} {1.05 * reach:.4g}" '
        f'width="320" style="display:block"><polygon points="{points}" fill="#2f7fd1" fill-opacity="0.2" '
        f'stroke="currentColor" stroke-width="{0.012 * reach:.4g}"/></svg>'
    )


def load_lens(path: Path | str) -> Lens:
    """Read what :meth:`Lens.save` wrote, in this version or in 0.1.0. Raises :class:`InputError` for anything else."""
    path = Path(path)
    content = read_json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds a {type(content).__name__}, not a lens; {_REMEDY}")
    if content.get("format") == EARLIER_FORMAT:
        content = {"schema": SCHEMA, **{key: value for key, value in content.items() if key != "format"}}
        for side in ("inner", "outer"):
            if isinstance(content.get(side), dict):
                content[side].setdefault("kind", "srbf")
    reject_outdated(content, SCHEMA, path, _REMEDY)
    try:
        record = LensRecord.model_validate({key: value for key, value in content.items() if key != "schema"})
    except ValidationError as error:
        raise refused(error, str(path), _REMEDY) from None
    spec = parse_spec(record.spec, str(path))
    try:
        inner, outer = record.inner.surface(), record.outer.surface()
    except InputError as error:
        raise InputError(f"{path}: {error}; {_REMEDY}") from None
    return Lens(inner, outer, spec, record.seed, record.accuracy, record.version)


def _describe(surface: Surface) -> str:
    if isinstance(surface, SrbfSurface):
        basis = surface.basis
        return f"{basis.size} functions in {len(basis.levels)} levels, symmetry {basis.symmetry}"
    return f"fixed {type(surface).__name__.lower()}"
