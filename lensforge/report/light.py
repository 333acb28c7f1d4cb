"""In what light is shown: W/m^2, or lux where the spec says how many lumens a watt of the source is."""

from dataclasses import dataclass

from lensforge.spec import Spec


@dataclass(frozen=True)
class LightUnit:
    """The quantity on a receiver, its unit, and how much of it 1 W/m^2 is."""

    quantity: str
    symbol: str
    per_w_m2: float

    @property
    def label(self) -> str:
        """For an axis or a scale."""
        return f"{self.quantity} ({self.symbol})"


WATTS = LightUnit("irradiance", "W/m²", 1.0)


def light_unit(spec: Spec) -> LightUnit:
    """Lux by ``source.luminous_efficacy_lm_per_w``, without it W/m^2."""
    efficacy = spec.source.luminous_efficacy_lm_per_w
    return WATTS if efficacy is None else LightUnit("illuminance", "lx", efficacy)
