"""States of a new zoom: a spot and a flood of one lens, the travel of the LED between them, and the room for it.

An LED that moves along the axis by t towards a lens whose light leaves along the axis changes the path of the ray at
the angle theta by t cos(theta). It turns that ray by the slope of this over the height h at which it leaves. A lens
without coma has h = R sin(theta) for the widest lens of radius R, so the ray turns by (t / R) tan(theta). Of a
Lambertian LED 64 % of the light lies within 53 degrees, where tan(theta) = 4/3: so much light is spread by (4/3) t / R.
"""

from math import radians
from typing import Any

from lensforge.spec.derived_values import CAVITY_HEIGHT, three_digits

_TRAVEL = 0.75  # of the radius and the change of the half angle (rad)
# Of the paraboloid that is kept clear: over the LED's radius, and over its travel. The LED then has a tenth in hand.
_CAVITY_RADIUS = 1.7
_CAVITY_HEIGHT = 1.8


def travel_mm(spot_deg: float, flood_deg: float, max_radius_mm: float) -> float:
    """Travel (mm) of the LED between beams of these full widths at half maximum, to 0.1 mm."""
    return max(0.1, round(_TRAVEL * max_radius_mm * 0.5 * radians(flood_deg - spot_deg), 1))


def zoom_states(spot_deg: float, flood_deg: float, travel: float) -> list[dict[str, Any]]:
    """Tables of ``[[states]]``: the spot where the LED stands at the origin, the flood after its ``travel`` (mm)."""
    return [
        {"name": "spot", "target": {"kind": "beam", "fwhm_deg": spot_deg}},
        {"name": "flood", "shift_mm": [0.0, 0.0, travel], "target": {"kind": "beam", "fwhm_deg": flood_deg}},
    ]


def room_for_travel(extent_mm: float, travel: float) -> dict[str, float]:
    """Fields of ``[constraints]`` that keep an LED of this radius (mm) clear over its ``travel``."""
    radius_mm = _CAVITY_RADIUS * extent_mm
    height_mm = max(_CAVITY_HEIGHT * travel, CAVITY_HEIGHT * radius_mm + travel)
    return {"cavity_radius_mm": three_digits(radius_mm), "cavity_height_mm": three_digits(height_mm)}
