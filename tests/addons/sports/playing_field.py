"""A playing field with two masts that differ."""

from typing import Any

FIELD: dict[str, Any] = {
    "lighting_class": "football II", "length_m": 100.0, "width_m": 60.0,
    "floodlights": [
        {"place_m": [-40.0, -38.0, 18.0], "aim_m": [-25.0, -5.0], "lamps": 3},
        {"place_m": [33.0, 41.0, 21.0], "aim_m": [20.0, 4.0]},
    ],
}  # fmt: skip
