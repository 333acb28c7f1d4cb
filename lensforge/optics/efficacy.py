"""Lumens and photons of 1 W of light: what it is to eyes and to plants."""

from typing import NamedTuple


class Efficacy(NamedTuple):
    """Lumens and photosynthetic photons (µmol/s, from 400 to 700 nm) of 1 W of light; None if nothing states them."""

    lumens: float | None = None
    photons: float | None = None


UNKNOWN = Efficacy()
