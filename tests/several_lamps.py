"""LEDs of unlike sizes, flux and places, and a board with lenses of two kinds."""

from typing import Any

from presets import FEW
from scenes import NO_TOLERANCES, random_surface, small_spec, sphere, tolerance_changes

from lensforge.scene.lens import Lens

NEAR = {"kind": "square", "side_mm": 0.8, "flux_w": 1.5}
FAR = {
    "kind": "rectangle", "width_mm": 0.9, "height_mm": 0.3, "flux_w": 0.9, "position_mm": [0.15, -0.1, 0.1],
    "tilt_deg": [0.0, 12.0],
}  # fmt: skip
LEDS = [{"name": "near", "source": NEAR}, {"name": "far", "source": FAR}]
BOTH = {"source": None, "sources": LEDS}
PLACES = [[0.0, 0.0], [15.0, 2.5], [-12.5, 10.0]]  # whole pixels apart
TABLE = {"kind": "table", "places_mm": PLACES, "turns_deg": [0.0, 20.0, -50.0], "kinds": ["a", "b", "b"]}
PATTERN = {"kind": "rectangle", "width_mm": 20.0, "height_mm": 20.0, "distance_mm": 20.0, "receiver_mm": 40.0}
KINDS = {  # the second without any symmetry
    "a": {"inner": sphere(3.0), "outer": sphere(6.0)},
    "b": {"inner": sphere(3.0), "outer": random_surface(2, 6.0, 0.06, (9, 25))},
}


def board(tolerances: dict[str, Any], lamps: dict[str, Any] = TABLE, kind: str = "") -> Lens:
    """The board of both kinds, or of lamps with the lens of one ``kind``."""
    spec = small_spec(
        **tolerance_changes({**NO_TOLERANCES, **tolerances}), lamps=lamps, target=PATTERN, base={"kind": "none"},
        evaluate__filter_variance=0.0,
    )  # fmt: skip
    if kind:
        return Lens(KINDS[kind], spec, 0, FEW)
    return Lens(KINDS["a"], spec, 0, FEW, others={"b": KINDS["b"]})
