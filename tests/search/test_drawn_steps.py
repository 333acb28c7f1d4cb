"""Steps of a search for profiles that are drawn along y."""

import lensforge as lf
from lensforge.spec.accuracy import preset_of

LINE = {
    "name": "line",
    "source": {"kind": "square", "side_mm": 0.5},
    "lens": {"kind": "extruded", "length_mm": 320.0, "ends": "free", "refractive_index": 1.4936},
    "constraints": {"max_radius_mm": 36.0},
    "lamps": {"kind": "grid", "columns": 1, "rows": 32, "pitch_mm": 10.0},
    "target": {"kind": "rectangle", "width_mm": 5.0, "height_mm": 300.0, "distance_mm": 300.0, "receiver_mm": 330.0},
    "optimise": {"aim": "share", "steps_per_level": [12], "rays": 512, "pixels": 66},
    "evaluate": {"pixels": 66, "rays": 4096},
}


def test_a_step_to_tables_below_zero_is_shortened() -> None:
    """By steps of 250 times the usual length the table of the inner face fell to -94 mm, which ended the search."""
    made = lf.design(lf.Spec(**LINE), accuracy=preset_of("draft").replace("long", effort={"learning_rate": 1.0}))
    assert made.steps == 12
