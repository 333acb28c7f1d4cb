"""Change of a material with temperature: its index by SCHOTT's formula or by a constant, and its linear expansion.

SCHOTT TIE-19 (2016): the change of the index relative to vacuum, from the temperature of the catalogue on. Indices here
are relative to air, which thins as it warms: its own index, by Kohlrausch's formula of OpticStudio's help ("Index of
refraction computation"), falls by 0.9e-6 per kelvin at 20 C, nearly half of what N-BK7 changes by in air. NumPy only.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

REFERENCE_C = 20.0  # of catalogues, and of a drawing's lengths (ISO 1)
LOWEST_C, HIGHEST_C = -100.0, 400.0
SCHOTT_COEFFICIENTS = 6
_MEASURED_C = (-100.0, 140.0)  # of SCHOTT's coefficients
_AIR_PER_K = 3.4785e-3  # at 15 C

Waves = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class TemperatureLaw:
    """Change of index and length from ``reference_c`` (Celsius) on; None or empty for what is not known.

    ``schott``: D0 (1/K), D1 (1/K^2), D2 (1/K^3), E0 (um^2/K), E1 (um^2/K^2), and the wavelength of the pole (um);
    without it ``index_per_k``, the change (1/K) of the index relative to air, at every wavelength.
    ``expansion_per_k``: coefficient of linear expansion (1/K).
    """

    reference_c: float = REFERENCE_C
    schott: tuple[float, ...] = ()
    index_per_k: float | None = None
    expansion_per_k: float | None = None

    @property
    def knows_index(self) -> bool:
        """True where the change of the index is known."""
        return bool(self.schott) or self.index_per_k is not None

    def index(self, cold: Waves, wavelengths_nm: Waves, celsius: float) -> Waves:
        """Index relative to air at ``celsius``, of a known law, from ``cold``, that at the reference temperature."""
        kelvin = celsius - self.reference_c
        if not self.schott:
            assert self.index_per_k is not None
            return cold + self.index_per_k * kelvin
        d0, d1, d2, e0, e1, pole_um = self.schott
        absolute = cold * air_index(wavelengths_nm, self.reference_c)
        near_pole = (e0 * kelvin + e1 * kelvin**2) / ((1e-3 * wavelengths_nm) ** 2 - pole_um**2)
        change = d0 * kelvin + d1 * kelvin**2 + d2 * kelvin**3 + near_pole
        warm = absolute + (absolute**2 - 1.0) / (2.0 * absolute) * change
        relative: Waves = warm / air_index(wavelengths_nm, celsius)
        return relative

    def scale(self, celsius: float) -> float:
        """Factor of every length at ``celsius``, of a known expansion."""
        assert self.expansion_per_k is not None
        return 1.0 + self.expansion_per_k * (celsius - self.reference_c)

    def warnings(self, celsius: float) -> tuple[str, ...]:
        """One line where SCHOTT's formula is used beyond the temperatures at which it was fitted."""
        low, high = _MEASURED_C
        if not self.schott or low <= celsius <= high:
            return ()
        return (f"the index at {celsius:g} C is extrapolated: SCHOTT's formula holds from {low:g} to {high:g} C",)


UNKNOWN = TemperatureLaw()


def air_index(wavelengths_nm: Waves, celsius: float) -> Waves:
    """Index of dry air at one atmosphere and ``celsius``: F. Kohlrausch, Praktische Physik 1 (1968), p. 408."""
    squared = (1e-3 * wavelengths_nm) ** 2
    at_15 = 6432.8 + 2949810.0 * squared / (146.0 * squared - 1.0) + 25540.0 * squared / (41.0 * squared - 1.0)
    found: Waves = 1.0 + 1e-8 * at_15 / (1.0 + (celsius - 15.0) * _AIR_PER_K)
    return found
