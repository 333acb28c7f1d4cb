"""Manufacturing and alignment errors: of form, position, source and index, each of a stated amount."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from lensforge.lens import Lens
from lensforge.sources.bundle import RayBundle, Source
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface
from lensforge.tolerancing.sensitivity_table import Amounts

Radius = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]

LOW_ORDER = 9  # functions over the hemisphere: errors as wide as astigmatism and coma
_ROUNDS = 3  # each gains three digits for displacements that are small compared with the lens
_SAMPLES = 4000


@dataclass(frozen=True)
class Perturbation:
    """One error: name, amount, unit, and the changed surfaces, source or index; the rest stays as designed."""

    name: str
    amount: float
    unit: str
    surfaces: dict[str, Radius] = field(default_factory=dict)
    source_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    index: float = 0.0


def perturbations(lens: Lens, amounts: Amounts, seed: int) -> list[Perturbation]:
    """List the errors: form of each surface, outer surface displaced from inner surface and source, source, index."""
    return [*_form(lens, amounts, seed), *_alignment(lens, amounts), *_source_and_index(amounts)]


def _form(lens: Lens, amounts: Amounts, seed: int) -> list[Perturbation]:
    found = []
    for number, name in enumerate(("inner", "outer")):
        surface = getattr(lens, name)
        for title, functions, rms in (
            ("low-order", LOW_ORDER, amounts.low_order_rms_mm),
            ("SRBF-scale", lens.basis.levels[-1], amounts.fine_rms_mm),
        ):
            wrong = with_form_error(surface, functions, lens.spec.lens.sigma_c, rms, seed + number)
            found.append(Perturbation(f"{title} form error, {name}", 1e3 * rms, "um rms", {name: wrong.radius}))
    return found


def _alignment(lens: Lens, amounts: Amounts) -> list[Perturbation]:
    def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0, tilt: float = 0.0) -> dict[str, Radius]:
        return {"outer": Displaced(lens.outer, (x, y, z), tilt).radius}

    decentre, gap, tilt = amounts.decentre_mm, amounts.gap_mm, amounts.tilt_rad
    return [
        Perturbation("decentre in x, outer against inner", 1e3 * decentre, "um", moved(x=decentre)),
        Perturbation("decentre in y, outer against inner", 1e3 * decentre, "um", moved(y=decentre)),
        Perturbation("tilt about x, outer against inner", 1e3 * tilt, "mrad", moved(tilt=tilt)),
        Perturbation("gap, outer against inner", 1e3 * gap, "um", moved(z=gap)),
        Perturbation("gap, outer against inner", -1e3 * gap, "um", moved(z=-gap)),
    ]


def _source_and_index(amounts: Amounts) -> list[Perturbation]:
    shift = amounts.source_mm
    axes = {"x": (shift, 0.0, 0.0), "y": (0.0, shift, 0.0), "z": (0.0, 0.0, shift)}
    found = [Perturbation(f"source shift in {axis}", 1e3 * shift, "um", source_mm=by) for axis, by in axes.items()]
    found.append(Perturbation("source shift in z", -1e3 * shift, "um", source_mm=(0.0, 0.0, -shift)))
    return found + [Perturbation("index", sign * amounts.index, "", index=sign * amounts.index) for sign in (1.0, -1.0)]


@dataclass(frozen=True)
class Displaced:
    """``surface`` rotated about the x axis of the lens by ``tilt_rad``, then shifted by ``shift_mm``."""

    surface: Surface
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_rad: float = 0.0

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the lens origin, by fixed-point steps on ``|x'| = rho(x'/|x'|)`` in its own frame."""
        cosine, sine = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
        along, shift = directions @ turn, np.array(self.shift_mm) @ turn
        radius = self.surface.radius(along)
        for _ in range(_ROUNDS):
            x = radius[:, None] * along - shift
            length = np.linalg.norm(x, axis=1)
            radius = radius - (length - self.surface.radius(x / length[:, None]))
        return radius


@dataclass(frozen=True)
class WithFormError:
    """``surface`` plus the radial ``error`` without its offset."""

    surface: Surface
    error: SrbfSurface

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) from the lens origin."""
        radius: Float[np.ndarray, " n"] = self.surface.radius(directions) + self.error.radius(directions)
        return radius - self.error.offset_mm


def with_form_error(surface: Surface, functions: int, sigma_c: float, rms_mm: float, seed: int) -> WithFormError:
    """Add a random sum of ``functions`` SRBFs; its ``rms_mm`` is along the normal, weighted by solid angle."""
    basis = SrbfBasis((functions,), sigma_c)
    weights = np.random.default_rng(seed).normal(size=basis.size)
    u = fibonacci_hemisphere(_SAMPLES)
    error = basis.evaluate(u) @ weights * np.sum(surface.normal(u) * u, axis=1)
    return WithFormError(surface, SrbfSurface(basis, weights * rms_mm / float(np.sqrt(np.mean(error**2))), 1.0))


@dataclass(frozen=True)
class ShiftedSource:
    """``source`` shifted by ``shift_mm``, and an error ``index`` of the refractive index for its rays.

    ``index`` is added to the refractive indices of rays that carry their own; for all others it is in the scene.
    """

    source: Source
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    index: float = 0.0

    @property
    def flux_w(self) -> float:
        """Flux (W) of the source itself."""
        return self.source.flux_w

    @property
    def symmetry(self) -> str:
        """No symmetry is left, in general."""
        return "none"

    @property
    def ray_count(self) -> int | None:
        """Number of rays of the source itself."""
        return self.source.ray_count

    def sample(self, count: int, seed: int) -> RayBundle:
        """Sample the source; shift its rays."""
        rays = self.source.sample(count, seed)
        own = rays.refractive_indices
        indices = None if own is None else own + self.index
        return replace(rays, origins=rays.origins + np.array(self.shift_mm), refractive_indices=indices)

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline of the source, shifted."""
        moved: Float[np.ndarray, "k 3"] = self.source.outline() + np.array(self.shift_mm)
        return moved
