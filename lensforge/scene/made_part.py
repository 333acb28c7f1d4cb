"""Parts as they are traced, from their deviations: tables and places of the faces, index, size of the source."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import Array, like
from lensforge.optics.media import Media
from lensforge.scene.as_made import AsMade, Displacement
from lensforge.scene.form_errors import ErrorField, FaceNodes, low_order, ripple, waviness
from lensforge.scene.lens import Lens
from lensforge.scene.perturbations import Deviations
from lensforge.scene.tolerance_factors import Factor
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.surface import Surface

_SEED = 5  # of the shapes of waviness: any number; those of two faces differ
_NONE = np.zeros(2)


@dataclass(frozen=True, eq=False)
class MadePart:
    """One part: errors of its faces' tables (mm, None for none), its deviations, and those of index and flux."""

    inner_error: Float[np.ndarray, "side side"] | None
    outer_error: Float[np.ndarray, "side side"] | None
    made: AsMade
    index: float
    flux: float

    def media(self, media: Media) -> Media:
        """``media`` with the index of the batch."""
        return media if self.index == 0.0 else replace(media, refractive_index=media.refractive_index + self.index)

    def rays(self, rays: RayBundle) -> RayBundle:
        """``rays`` with the index of the batch, where they carry their own."""
        own = rays.refractive_indices
        return rays if own is None or self.index == 0.0 else replace(rays, refractive_indices=own + self.index)

    def tables(
        self, inner: Float[Array, "side side"], outer: Float[Array, "side side"]
    ) -> tuple[Float[Array, "side side"], Float[Array, "side side"]]:
        """The faces' tables with their errors; differentiable in the tables as designed."""
        first, second = (
            table if error is None else table + like(table, error)
            for table, error in ((inner, self.inner_error), (outer, self.outer_error))
        )
        return first, second


@dataclass(frozen=True, eq=False)
class PartMaker:
    """All that is prepared once: the tables of each face's form errors, by the name of the factor."""

    errors: dict[str, ErrorField]
    seat_mm: float
    source_mm: tuple[float, float, float]

    @staticmethod
    def of(spec: Spec, surfaces: tuple[Surface, Surface], grid: TableGrid, factors: tuple[Factor, ...]) -> "PartMaker":
        """Prepare the form errors of ``surfaces``, inner and outer, on tables of ``grid``."""
        section, names = spec.tolerances, {factor.name for factor in factors}
        errors = {}
        for number, (face, surface) in enumerate(zip(("inner", "outer"), surfaces, strict=True)):
            if not any(f"{face}_{kind}_um" in names for kind in ("form", "waviness", "ripple")):
                continue
            sampled = FaceNodes.of(grid, surface)
            if f"{face}_form_um" in names:
                errors[f"{face}_form_um"] = low_order(sampled)
            if f"{face}_waviness_um" in names:
                band = section.waviness_shortest_mm, section.waviness_longest_mm, section.waviness_exponent
                errors[f"{face}_waviness_um"] = waviness(sampled, *band, _SEED + number)
            if f"{face}_ripple_um" in names:
                errors[f"{face}_ripple_um"] = ripple(sampled, section.ripple_period_mm)
        return PartMaker(errors, spec.base.seat_mm, spec.source.position_mm)

    @staticmethod
    def of_lens(lens: Lens, grid: TableGrid, factors: tuple[Factor, ...]) -> "PartMaker":
        """The same for a finished lens."""
        return PartMaker.of(lens.spec, (lens.inner, lens.outer), grid, factors)

    def part(self, found: Deviations) -> MadePart:
        """The part with these deviations."""

        def one(name: str) -> float:
            return float(found[name][0]) if name in found else 0.0

        def placed(shift: str, height: str, tilt: str, centre: tuple[float, float, float]) -> Displacement:
            x, y = found.get(shift, _NONE).tolist()
            about_x, about_y = found.get(tilt, _NONE).tolist()
            return Displacement((x, y, one(height)), (about_x, about_y), centre)

        origin = (0.0, 0.0, 0.0)
        made = AsMade(
            source=placed("source_shift_mm", "source_height_mm", "source_tilt_deg", self.source_mm),
            lens=placed("lens_shift_mm", "lens_height_mm", "lens_tilt_deg", origin),
            outer=placed("outer_shift_mm", "gap_mm", "outer_tilt_deg", origin),
            source_size=1.0 + one("source_size"),
            scale=1.0 + one("shrinkage"),
            seat_mm=self.seat_mm,
            inner_slope=self._slope("inner", found),
            outer_slope=self._slope("outer", found),
        )
        return MadePart(
            self._error("inner", found), self._error("outer", found), made, one("index"), 1.0 + one("source_flux")
        )

    def _slope(self, face: str, found: Deviations) -> float:
        """Rms slope of a face along any line: its roughness, and what of its errors is too fine for the tables."""
        squared = float(found[f"{face}_roughness_mrad"][0]) ** 2 if f"{face}_roughness_mrad" in found else 0.0
        for name in (f"{face}_waviness_um", f"{face}_ripple_um"):
            if name in self.errors and name in found:
                # the numbers of a field are standard normal: their mean square times that of the amount
                squared += float(np.mean(found[name] ** 2)) * self.errors[name].slope ** 2
        return float(np.sqrt(squared))

    def _error(self, face: str, found: Deviations) -> Float[np.ndarray, "side side"] | None:
        total = None
        for name in (f"{face}_form_um", f"{face}_waviness_um", f"{face}_ripple_um"):
            if name in self.errors and name in found and len(self.errors[name].tables):
                error = np.tensordot(found[name], self.errors[name].tables, axes=1)
                total = error if total is None else total + error
        return total
