"""The process by which a lens is made: derived from its kind, and what it says of each face."""

import pytest
from scenes import small_spec
from tir_lenses import spot

import lensforge as lf

PLATE = {"plate": {"thickness_mm": 1.0}, "lamps": {"kind": "grid", "rows": 1, "columns": 1, "pitch_mm": 80.0}}
ROUND = {"kind": "asphere", "vertex_z_mm": 3.0, "radius_mm": -3.0}
FREE = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -3.0, "radius_y_mm": -3.5}


@pytest.mark.parametrize(
    ("spec", "process", "faces"),
    [
        (small_spec(), "milled", ["milled", "milled"]),
        (small_spec(manufacture__process="turned"), "turned", ["turned", "turned"]),
        (small_spec(manufacture__process="moulded"), "moulded", ["milled", "milled"]),
        (small_spec(manufacture__process="moulded", lens__inner={"fixed": ROUND}), "moulded", ["turned", "milled"]),
        (small_spec(manufacture__process="moulded", lens__inner={"fixed": FREE}), "moulded", ["milled", "milled"]),
        (small_spec(manufacture__process="printed"), "printed", [None, None]),
        (spot(), "turned", ["turned"] * 4),
        (spot(levels=[25]), "milled", ["milled"] * 4),
        (spot().replace({"manufacture.process": "moulded"}), "moulded", ["turned"] * 4),
        (spot().replace({"manufacture.process": "milled"}), "milled", ["milled"] * 4),
        (
            spot(levels=[25], exit={"flat": True}).replace({"manufacture.process": "moulded"}),
            "moulded",
            ["milled", "turned", "milled", "turned"],
        ),
    ],
)
def test_faces_of_revolution_are_turned_unless_the_spec_says_otherwise(
    spec: lf.Spec, process: str, faces: list[str | None]
) -> None:
    assert spec.manufacture.process == process
    assert [spec.cutting(name) for name in spec.lens.names] == faces
    assert spec.manufacture.cuts == {"moulded": "inserts", "printed": None}.get(process, "lens")


def test_a_plate_is_moulded_and_a_derived_process_follows_the_spec() -> None:
    plate = small_spec().replace(PLATE)
    assert plate.manufacture.process == "moulded" and "process" not in plate.to_toml()
    assert plate.replace(plate=None).manufacture.process == "milled"
    stated = plate.replace({"manufacture.process": "milled"})
    assert stated.replace(lamps=None, plate=None).manufacture.process == "milled"
    assert 'process = "milled"' in stated.to_toml()


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"layer_um": 5.0}, r'layer_um = 5 goes with process = "printed", not "turned"'),
        ({"shank_width_mm": 0.03}, r"shank_width_mm = 0\.03: must be at least twice nose_radius_mm, 0\.04"),
        (
            {"included_angle_deg": 150.0, "clearance_deg": 15.0},
            r"clearance and half the angle must together be below 90",
        ),
    ],
)
def test_a_tool_that_cannot_be_is_refused(fields: dict[str, float], line: str) -> None:
    with pytest.raises(lf.InputError, match=line):
        spot().replace({"manufacture": fields})


def test_what_is_not_moulded_does_not_shrink() -> None:
    assert spot().replace({"manufacture": {"process": "moulded", "shrinkage": 0.01}}).manufacture.scale == 1.01
    with pytest.raises(lf.InputError, match=r'shrinkage = 0\.01 goes with process = "moulded", not "turned"'):
        spot().replace({"manufacture.shrinkage": 0.01})
