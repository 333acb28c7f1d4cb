"""Unit in which light is shown: per watt, or per lumen where the luminous efficacy of the source is known."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LightUnit:
    """The quantity on a receiver, its unit, and how much of it 1 W/m^2, or in the far field 1 W/sr, is."""

    quantity: str
    symbol: str
    per_watt: float

    @property
    def label(self) -> str:
        """Label of an axis or a scale."""
        return f"{self.quantity} ({self.symbol})"


WATTS = LightUnit("irradiance", "W/m²", 1.0)
WATTS_PER_SR = LightUnit("intensity", "W/sr", 1.0)


def light_unit(lumens_per_watt: float | None, *, far_field: bool = False) -> LightUnit:
    """Lux or candela if the source's luminous efficacy is known, else W/m^2 or W/sr."""
    if lumens_per_watt is None:
        return WATTS_PER_SR if far_field else WATTS
    quantity, symbol = ("luminous intensity", "cd") if far_field else ("illuminance", "lx")
    return LightUnit(quantity, symbol, lumens_per_watt)
