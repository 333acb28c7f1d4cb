"""The process by which a lens is made: derived from its kind, and what it says of each face."""

from typing import get_args

import pytest
from scenes import small_spec
from tir_lenses import spot

import lensforge as lf
from lensforge.spec.processes import PROCESSES, Process

PLATE = {"plate": {"thickness_mm": 1.0}, "lamps": {"kind": "grid", "rows": 1, "columns": 1, "pitch_mm": 80.0}}
ROUND = {"kind": "asphere", "vertex_z_mm": 3.0, "radius_mm": -3.0}
LINEAR = small_spec(
    lens={"kind": "extruded", "length_mm": 40.0, "profile": 9}, base={"kind": "none"}, manufacture={},
    optimise__steps_per_level=[1],
)  # fmt: skip
FREE = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -3.0, "radius_y_mm": -3.5}
CUTS = {"moulded": "inserts", "extruded": None, "printed": None, "none": None}


@pytest.mark.parametrize(
    ("spec", "process", "faces"),
    [
        (small_spec(), "milled", ["milled", "milled"]),
        (small_spec(manufacture__process="turned"), "turned", ["turned", "turned"]),
        (small_spec(manufacture__process="moulded"), "moulded", ["milled", "milled"]),
        (small_spec(manufacture__process="moulded", lens__inner={"fixed": ROUND}), "moulded", ["turned", "milled"]),
        (small_spec(manufacture__process="moulded", lens__inner={"fixed": FREE}), "moulded", ["milled", "milled"]),
        (small_spec(manufacture__process="printed"), "printed", [None, None]),
        (LINEAR, "extruded", [None, None]),
        (LINEAR.replace({"manufacture.process": "milled"}), "milled", ["milled", "milled"]),
        (spot(), "turned", ["turned"] * 4),
        (spot(levels=[25]), "moulded", ["milled", "turned", "milled", "milled"]),
        (small_spec(manufacture__process="none"), "none", [None, None]),
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
    assert spec.manufacture.cuts == CUTS.get(process, "lens")


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


@pytest.mark.parametrize("spec", [small_spec(), spot()])
def test_only_a_linear_lens_is_extruded(spec: lf.Spec) -> None:
    kind = spec.lens.kind
    with pytest.raises(lf.InputError, match=rf'process = "extruded": a lens of kind "{kind}" is drawn through no die'):
        spec.replace({"manufacture.process": "extruded"})
    with pytest.raises(lf.InputError, match=r'most_wall_ratio = 3 goes with process = "extruded", not "milled"'):
        LINEAR.replace({"manufacture": {"process": "milled", "most_wall_ratio": 3.0}})


NOTHING = (None, None)


@pytest.mark.parametrize(
    ("spec", "asked"),
    [
        (small_spec(manufacture={"cutter_radius_mm": 0.6}), {"inner": (0.6, -25.0576), "outer": (0.6, 0.0)}),
        (small_spec(manufacture={"max_tilt_deg": 7.0}), {"inner": (0.5, -7.0), "outer": (0.5, 0.0)}),
        (small_spec(manufacture={"max_tilt_deg": 0.0}), {"inner": (0.5, 0.0), "outer": (0.5, 0.0)}),
        (small_spec(manufacture={}, base={"kind": "none"}), {"inner": (0.5, -38.2319), "outer": (0.5, None)}),
        (small_spec(manufacture={}, base={"height_mm": 1.8}), {"inner": (0.5, -26.9377), "outer": (0.5, 0.0)}),
        (
            small_spec(manufacture={}, base={"height_mm": 1.8, "relief_step_mm": 0.78, "relief_setback_mm": 0.2}),
            {"inner": (0.5, -26.9377), "outer": (0.5, -34.0558)},
        ),
        (
            small_spec(manufacture={}, base={"height_mm": 1.8, "relief_step_mm": 0.78, "relief_setback_mm": 0.05}),
            {"inner": (0.5, -26.9377), "outer": (0.5, -25.8419)},
        ),
        (
            small_spec(manufacture={}, base={"relief_step_mm": 0.6, "relief_setback_mm": 0.2}),
            {"inner": (0.5, -26.0446), "outer": (0.5, -11.5370)},
        ),
        (
            small_spec(manufacture={"process": "moulded", "cutter_radius_mm": 0.7, "nose_radius_mm": 0.05}),
            {"inner": (0.7, 2.0), "outer": (0.7, 2.0)},
        ),
        (spot().replace({"manufacture.required": True}), dict.fromkeys(("cap", "side", "wall", "exit"), (0.02, None))),
        (
            spot().replace({"manufacture": {"process": "moulded", "nose_radius_mm": 0.05, "required": True}}),
            dict.fromkeys(("cap", "side", "wall", "exit"), (0.05, 2.0)),
        ),
        (small_spec(manufacture={"process": "printed"}), {"inner": NOTHING, "outer": NOTHING}),
        (LINEAR, {"inner": NOTHING, "outer": NOTHING}),
        (small_spec(manufacture={"process": "none"}), {"inner": NOTHING, "outer": NOTHING}),
        (small_spec(manufacture={"required": False}), {"inner": NOTHING, "outer": NOTHING}),
        (small_spec(lens__inner={"fixed": ROUND}, manufacture={}), {"inner": NOTHING, "outer": (0.5, 0.0)}),
    ],
)
def test_a_search_keeps_what_the_process_asks_of_each_face_that_it_shapes(
    spec: lf.Spec, asked: dict[str, tuple[float | None, float | None]]
) -> None:
    """Of a mill undercuts by hand: (1 + sin u) R is the step of the base and (1 - cos u) R its setback, 0 if that is
    not stated; in the cavity u = atan(3 / d) - asin(R / s) with the depth d of 3 mm and the base, and s that of its
    edge from there.
    """
    kept = {name: spec.face_limits(name) for name in spec.lens.names}
    for name, (radius_mm, draft_deg) in asked.items():
        assert kept[name].concave_radius_mm == radius_mm
        assert kept[name].draft_deg == (None if draft_deg is None else pytest.approx(draft_deg, abs=1e-4))


def test_a_stated_radius_is_a_stricter_wish_and_a_stated_draft_another_one() -> None:
    stated = {"concave_radius_mm": 1.5, "draft_deg": 1.0}
    spec = small_spec(lens__outer={"offset_mm": 6.0, **stated}, manufacture={"process": "moulded"})
    assert vars(spec.face_limits("outer")) == stated
    lower = spec.replace({"lens.outer.concave_radius_mm": 0.4})
    assert lower.face_limits("outer").concave_radius_mm == 0.5, "the tool decides"
    assert vars(spec.replace({"manufacture.required": False}).face_limits("outer")) == stated
    assert vars(spec.made_by("milled").face_limits("outer")) == stated, "the search has not kept what that asks"


def test_a_face_that_follows_another_is_asked_for_nothing() -> None:
    spec = lf.Spec(
        source=lf.SquareSource(side_mm=1.0),
        lens=lf.ReflectorSection(),
        constraints={"max_radius_mm": 15.0},
        target={"kind": "beam", "fwhm_deg": 20.0},
    )
    follows = [name for name in spec.lens.names if spec.lens.role(name).follows]
    assert follows and all(spec.face_limits(name).concave_radius_mm is None for name in follows)


@pytest.mark.parametrize(("radius_mm", "ball_mm"), [(14.0, 0.5), (2.5, 0.5), (2.45, 0.49), (1.234e-3, 2.47e-4)])
def test_a_small_lens_has_a_smaller_ball(radius_mm: float, ball_mm: float) -> None:
    spec = small_spec(
        constraints={
            "max_radius_mm": radius_mm,
            "cavity_radius_mm": 0.3 * radius_mm,
            "cavity_height_mm": 0.1 * radius_mm,
        },
        lens={"inner": {}, "outer": {}, "levels": [9, 25]},
        target={"kind": "beam", "fwhm_deg": 60.0},
    )
    assert spec.manufacture.cutter_radius_mm == ball_mm


@pytest.mark.parametrize(
    ("changes", "height_mm"),
    [
        ({"manufacture.cutter_radius_mm": 0.98}, 2.0),  # 0.98 mm of step, 1 mm of wall, 0.02 mm to spare
        ({"manufacture.cutter_radius_mm": 0.99}, 2.5),
        ({"manufacture.cutter_radius_mm": 2.1}, 3.5),
        ({"manufacture.cutter_radius_mm": 1.0, "base.flange_diameter_mm": 20.0, "base.flange_height_mm": 0.6}, 3.0),
        ({"manufacture.cutter_radius_mm": 2.1, "manufacture.process": "moulded"}, 2.0),
        ({"manufacture.cutter_radius_mm": 2.1, "manufacture.process": "none"}, 2.0),
        ({"manufacture.cutter_radius_mm": 2.1, "manufacture.required": False}, 2.0),
        ({"manufacture.cutter_radius_mm": 2.1, "base.height_mm": 2.2}, 2.2),
    ],
)
def test_a_base_is_as_high_as_the_step_for_the_ball_and_a_wall(changes: dict[str, object], height_mm: float) -> None:
    spec = small_spec(manufacture={}).replace(changes)
    assert spec.base.height_mm == height_mm
    assert ("\nheight_mm" in spec.to_toml()) == ("base.height_mm" in changes)


def test_no_base_hides_a_wall_that_tools_reach_from_below_unless_it_is_stated() -> None:
    stated = spot()
    spec = lf.Spec(**{**stated.model_dump(exclude_unset=True), "base": {}, "manufacture": {}})
    assert spec.base.kind == "none"
    assert spec.replace({"manufacture.process": "moulded"}).base.kind == "none"
    assert spec.replace({"manufacture.process": "printed"}).base.kind == "cylinder"
    assert spec.replace({"base.diameter_mm": 30.0}).base.kind == "cylinder"


def test_a_study_of_light_has_no_part_that_could_be_required() -> None:
    study = small_spec(manufacture={"process": "none"})
    assert not study.manufacture.required and small_spec(manufacture={}).manufacture.required
    with pytest.raises(
        lf.InputError, match='required = true goes with a part, not with process = "none"; leave it out'
    ):
        study.replace({"manufacture.required": True})


def test_every_process_has_its_name_among_the_choices() -> None:
    assert tuple(PROCESSES) == get_args(Process)
