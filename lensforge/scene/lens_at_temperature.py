"""A lens at another temperature: it has another index, and every length of it is another.

It grows about its seat, the bottom of its base, which stays where it is, as do source and receivers.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydantic import JsonValue

from lensforge.errors import InputError
from lensforge.optics.material import HIGHEST_C, LOWEST_C, Material
from lensforge.optics.media import Media
from lensforge.scene.lens import Lens
from lensforge.surfaces.surface import scaled

# The range that a spec may state.
_LEAST_INDEX = 1.0
_LARGEST_INDEX = 4.0
_CHECKED = 100  # wavelengths of the range at which the index is tried
_FIELDS = {
    "index_per_k": "lens.index_per_k (1/K, of a data sheet: about -1e-4 for plastics, -4e-4 for silicones)",
    "expansion_per_k": "lens.expansion_per_k (1/K: about 7e-5 for plastics, 3e-4 for silicones, 7e-6 for glasses)",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class LensAtTemperature(Lens):
    """``designed`` at ``temperature_c``: scaled surfaces about the origin; its record is that of the lens as designed.

    It lies higher by ``raised_mm`` than these surfaces: to rays of the source all of it is shifted along +z.
    """

    designed: Lens
    temperature_c: float

    @property
    def scale(self) -> float:
        """Factor of every length."""
        return self.spec.lens.temperature_law.scale(self.temperature_c)

    @property
    def raised_mm(self) -> float:
        """Height of the lens's origin above that of the source, as the base grows from its seat."""
        return self.spec.base.seat_mm * (self.scale - 1.0)

    @property
    def reach_mm(self) -> float:
        """Radius of the ball about the origin in which it lies, raised."""
        return self.scale * self.designed.reach_mm + abs(self.raised_mm)

    @property
    def refractive_index(self) -> float:
        """Index of the body at the design wavelength."""
        lens = self.spec.lens
        cold = np.array([lens.refractive_index])
        wave = np.array([lens.design_wavelength_nm])
        return float(lens.temperature_law.index(cold, wave, self.temperature_c)[0])

    @property
    def media(self) -> Media:
        """Media of the design, but for the index of the body."""
        cold = self.designed.media
        body = replace(cold.body, refractive_index=self.refractive_index, material=self.dispersion)
        return replace(cold, body=body)

    @property
    def dispersion(self) -> Material | None:
        """Index against wavelength at the temperature."""
        lens = self.spec.lens
        return None if lens.dispersion is None else lens.dispersion.at(lens.temperature_law, self.temperature_c)

    def __eq__(self, other: object) -> bool:
        """True where ``other`` is the same lens at the same temperature."""
        alike = isinstance(other, LensAtTemperature) and self.temperature_c == other.temperature_c
        return alike and super().__eq__(other)

    __hash__ = Lens.__hash__

    def to_json(self) -> dict[str, JsonValue]:
        """The content of the ``lens.json`` of the lens as designed: its hash names this one, too."""
        return self.designed.to_json()


def at_temperature(lens: Lens, celsius: float) -> Lens:
    """``lens`` at ``celsius``; itself at its reference temperature.

    Raises :class:`InputError` where its change is not known, and out of -100 to 400 C.
    """
    law = lens.spec.lens.temperature_law
    if not LOWEST_C <= celsius <= HIGHEST_C:
        raise InputError(f"temperature_c = {celsius:g}: must be {LOWEST_C:g} to {HIGHEST_C:g} (Celsius)")
    if celsius == law.reference_c:
        return lens
    known = {"index_per_k": law.knows_index, "expansion_per_k": law.expansion_per_k is not None}
    missing = [description for name, description in _FIELDS.items() if not known[name]]
    if missing:
        raise InputError(
            f"temperature_c = {celsius:g}: nothing is known of how {lens.spec.lens.material} changes with it; give "
            f"{' and '.join(missing)}"
        )
    scale = law.scale(celsius)
    warm = LensAtTemperature(
        surfaces={name: scaled(surface, scale) for name, surface in lens.surfaces.items()},
        others={
            kind: {name: scaled(surface, scale) for name, surface in surfaces.items()}
            for kind, surfaces in lens.others.items()
        },
        spec=lens.spec,
        seed=lens.seed,
        accuracy=lens.accuracy,
        version=lens.version,
        designed=lens,
        temperature_c=celsius,
    )
    _require_indices(warm)
    return warm


def _require_indices(lens: LensAtTemperature) -> None:
    """Refuse a temperature at which the law gives an index that no material has."""
    indices = np.array([lens.refractive_index])
    if lens.dispersion is not None:
        indices = np.append(indices, lens.dispersion.index(np.linspace(*lens.dispersion.range_nm, _CHECKED)))
    wrong = indices[~((indices >= _LEAST_INDEX) & (indices <= _LARGEST_INDEX))]
    if len(wrong):
        raise InputError(
            f"temperature_c = {lens.temperature_c:g}: the index of {lens.spec.lens.material} would be {wrong[0]:.4g}, "
            f"must be {_LEAST_INDEX:g} to {_LARGEST_INDEX:g}; correct its change per kelvin"
        )
