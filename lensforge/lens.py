"""The record where the two stages meet: two frozen surfaces, the spec they serve, and how they came to be.

The design stage writes it, the geometry stage reads it; NumPy only. ``lens.json`` holds all of it.
"""

from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from lensforge.errors import InputError
from lensforge.files import read_json, write_json
from lensforge.spec import Spec, parse_spec
from lensforge.surfaces.conic import Asphere
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface
from lensforge.version import __version__

FORMAT = "lensforge-lens-1"


@dataclass(frozen=True)
class Lens:
    """Two surfaces, one of them perhaps fixed: ``inner`` faces the source, ``outer`` the target; lengths in mm."""

    inner: Surface
    outer: Surface
    spec: Spec
    seed: int
    accuracy: str
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

    def save(self, path: Path) -> None:
        """Write ``lens.json``; weights are written with all of their digits."""
        write_json(
            path,
            {
                "format": FORMAT,
                "version": self.version,
                "seed": self.seed,
                "accuracy": self.accuracy,
                "units": {"length": "mm", "angle": "rad"},
                "inner": _surface_to_json(self.inner),
                "outer": _surface_to_json(self.outer),
                "spec": self.spec.model_dump(mode="json"),
            },
        )

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


def load_lens(path: Path) -> Lens:
    """Read what :meth:`Lens.save` wrote. Raises :class:`InputError` for anything else."""
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{path}: not a lens file; its 'format' should be {FORMAT!r}")
    try:
        return Lens(
            inner=_surface_from_json(content["inner"]),
            outer=_surface_from_json(content["outer"]),
            spec=parse_spec(content["spec"], str(path)),
            seed=int(content["seed"]),
            accuracy=str(content["accuracy"]),
            version=str(content["version"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: damaged lens file ({type(error).__name__}: {error})") from None


def _describe(surface: Surface) -> str:
    if isinstance(surface, SrbfSurface):
        basis = surface.basis
        return f"{basis.size} functions in {len(basis.levels)} levels, symmetry {basis.symmetry}"
    return f"fixed {type(surface).__name__.lower()}"


def _surface_to_json(surface: Surface) -> dict[str, Any]:
    match surface:
        case SrbfSurface():
            return _srbf_to_json(surface)
        case Asphere():
            return {"kind": "asphere", **asdict(surface)}
    raise TypeError(f"{type(surface).__name__} has no place in a lens file")


def _srbf_to_json(surface: SrbfSurface) -> dict[str, Any]:
    basis = surface.basis
    return {
        "kind": "srbf",
        "levels": list(basis.levels),
        "sigma_c": basis.sigma_c,
        "symmetry": basis.symmetry,
        "offset_mm": surface.offset_mm,
        "weights_mm": surface.weights.tolist(),
    }


def _surface_from_json(content: dict[str, Any]) -> Surface:
    if content.get("kind", "srbf") == "asphere":
        vertex, radius, conic = (float(content[name]) for name in ("vertex_mm", "radius_mm", "conic"))
        return Asphere(vertex, radius, conic, tuple(float(value) for value in content["coefficients"]))
    basis = SrbfBasis(tuple(content["levels"]), float(content["sigma_c"]), content["symmetry"])
    return SrbfSurface(basis, np.array(content["weights_mm"], dtype=np.float64), float(content["offset_mm"]))
