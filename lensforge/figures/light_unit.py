"""Unit in which light is shown: W/m^2, or lux where the luminous efficacy of the source is known."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LightUnit:
    """The quantity on a receiver, its unit, and how much of it 1 W/m^2 is."""

    quantity: str
    symbol: str
    per_w_m2: float

    @property
    def label(self) -> str:
        """Label of an axis or a scale."""
        return f"{self.quantity} ({self.symbol})"


WATTS = LightUnit("irradiance", "W/m²", 1.0)


def light_unit(lumens_per_watt: float | None) -> LightUnit:
    """Lux if the source's luminous efficacy is known, else W/m^2."""
    return WATTS if lumens_per_watt is None else LightUnit("illuminance", "lx", lumens_per_watt)
