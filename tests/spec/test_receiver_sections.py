"""Receivers and their targets in a spec: every kind is kept by files and by replace; a wrong one is one line."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.spec import ReceiverSection, Spec, TargetSection, parse_spec

Table = dict[str, Any]
DISC: Table = {"kind": "disc", "diameter_mm": 80.0}
PLANE: Table = {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 200.0, "height_mm": 150.0}
FAR: Table = {"kind": "far_field", "half_angle_deg": 60.0}
CYLINDER: Table = {"kind": "cylinder", "radius_mm": 100.0, "width_mm": 200.0, "height_mm": 100.0}
SPHERE: Table = {"kind": "sphere", "radius_mm": 100.0, "half_angle_deg": 60.0}

_TWO = (DISC, {"kind": "rectangle", "width_mm": 90.0, "height_mm": 30.0, "edge_mm": 2.0, "uniform_mm": [80.0, 20.0]})
RECEIVERS = (
    lf.PlaneReceiver(centre_mm=(30.0, 0.0, 100.0), tilt_deg=(0.0, 20.0), width_mm=200.0, height_mm=90.0, targets=_TWO),
    lf.PlaneReceiver(
        centre_mm=(0.0, 60.0, 80.0), normal=(0.0, 1.0, 0.5), width_mm=90.0, height_mm=90.0, window_mm=(50.0, 40.0),
        rotation_deg=30.0, share=2.0, targets=(lf.DiscTarget(diameter_mm=30.0),),
    ),
    lf.FarFieldReceiver(axis=(0.1, 0.0, 1.0), half_angle_deg=60.0, targets=(lf.BeamTarget(fwhm_deg=30.0),)),
    lf.CylinderReceiver(
        centre_mm=(0.0, 5.0, 0.0), facing=(1.0, 0.0, 1.0), radius_mm=90.0, width_mm=120.0, height_mm=60.0,
        targets=(lf.TextTarget(text="A", width_mm=50.0), lf.DiscTarget(diameter_mm=9.0, centre_mm=(4.0, 0.0))),
    ),
    lf.SphereReceiver(name="dome", radius_mm=90.0, half_angle_deg=70.0, targets=(lf.DiscTarget(diameter_mm=60.0),)),
)  # fmt: skip
IN_MM: tuple[Table, ...] = (
    {"kind": "flat_top", "width_mm": 80.0, "height_mm": 40.0, "exponent": 8.0},
    {"kind": "rectangle", "width_mm": 80.0, "height_mm": 40.0, "edge_mm": 3.0, "uniform_mm": [60.0, 30.0]},
    {**DISC, "centre_mm": [5.0, -5.0], "rotation_deg": 20.0, "level": 2.0},
    {"kind": "ellipse", "width_mm": 80.0, "height_mm": 40.0},
    {"kind": "ring", "outer_diameter_mm": 80.0, "inner_diameter_mm": 40.0},
    {"kind": "polygon", "corners_mm": [[0.0, 0.0], [40.0, 0.0], [0.0, 30.0]]},
    {"kind": "cross", "length_mm": 80.0, "stroke_mm": 10.0},
    {"kind": "text", "text": "pi", "width_mm": 80.0, "height_mm": 30.0},
    {"kind": "image", "file": "/cat.png", "width_mm": 80.0, "luminance": "srgb"},
    {"kind": "table", "file": "/light.csv", "width_mm": 80.0},
    {"kind": "array", "values": lf.ArrayTarget(np.eye(3), width_mm=1.0).values.tolist(), "width_mm": 80.0},
    {"kind": "spots", "columns": 3, "rows": 2, "diameter_mm": 9.0, "pitch_mm": 20.0},
)
OF_DIRECTIONS: tuple[Table, ...] = (
    {"kind": "beam", "fwhm_deg": [40.0, 20.0], "profile": "cosine"},
    {"kind": "beam", "fwhm_deg": 40.0, "profile": "flat", "edge_deg": 2.0},
    {"kind": "batwing", "to_deg": 50.0, "edge_deg": 1.0, "uniform_deg": 40.0},
    {"kind": "camera", "width_deg": 70.0, "height_deg": 50.0, "rolloff": 3.0, "edge_deg": 1.0, "uniform_deg": 40.0},
    {"kind": "photometric", "file": "/street.ies", "centre_deg": [5.0, 0.0], "rotation_deg": 90.0},
)


def _in_degrees(target: Table) -> Table:
    return {name.replace("_mm", "_deg"): value for name, value in target.items()}


KINDS = TargetSection.kinds
IN_DEGREES = (*map(_in_degrees, IN_MM), *OF_DIRECTIONS)


def _on(receiver: Table, *targets: Table) -> Table:
    return {**receiver, "targets": list(targets)}


def _content(receivers: list[Any], **more: Any) -> Table:
    sections = small_spec().model_dump(mode="json", exclude_unset=True)
    del sections["target"]
    return {**sections, "receivers": receivers, **more}


def _spec(*receivers: Any, **more: Any) -> Spec:
    return parse_spec(_content(list(receivers), **more), "spec.toml")


def _require_kept(spec: Spec, folder: Path) -> None:
    """A spec comes back equal from TOML, from its file, and from a change that is undone."""
    assert parse_spec(tomllib.loads(spec.to_toml()), "again") == spec
    spec.save(folder / "spec.toml")
    again = parse_spec(
        tomllib.loads((folder / "spec.toml").read_text(encoding="utf-8")), "again", folder
    )  # no file is there
    assert again == spec and again.all_receivers == spec.all_receivers
    assert spec.replace(name="x").replace(name=spec.name) == spec


def test_the_receivers_and_targets_here_are_of_every_kind() -> None:
    assert {type(receiver) for receiver in RECEIVERS} == set(ReceiverSection.kinds.values())
    assert {target["kind"] for target in IN_DEGREES} == set(KINDS)
    assert {target["kind"] for target in IN_MM} == set(KINDS) - {target["kind"] for target in OF_DIRECTIONS}


@pytest.mark.parametrize("receiver", RECEIVERS, ids=lambda receiver: receiver.kind)
def test_every_kind_of_receiver_is_kept(receiver: Any, tmp_path: Path) -> None:
    spec = small_spec().replace(target=None, receivers=(receiver,))
    assert spec.target is None and spec.all_receivers[0].name == (receiver.name or receiver.kind)
    assert spec.receivers == (receiver,)
    _require_kept(spec, tmp_path)


@pytest.mark.parametrize("target", IN_MM, ids=lambda target: target["kind"])
def test_every_target_in_mm_is_kept(target: Table, tmp_path: Path) -> None:
    spec = _spec(*(_on(receiver, target) for receiver in (PLANE, CYLINDER, SPHERE)))
    assert [receiver.targets[0].unit for receiver in spec.receivers] == ["mm"] * 3
    _require_kept(spec, tmp_path)


@pytest.mark.parametrize("target", IN_DEGREES, ids=lambda target: target["kind"])
def test_every_target_in_degrees_is_kept_alone_and_on_its_receiver(target: Table, tmp_path: Path) -> None:
    inside = _spec(_on(FAR, target))
    assert inside.receivers[0].targets[0].unit == "deg"
    _require_kept(inside, tmp_path)
    alone = _spec(target={**target, "half_angle_deg": 60.0})
    _require_kept(alone, tmp_path)
    assert alone.receivers == () and alone.all_receivers[0].kind == "far_field"
    assert alone.all_receivers[0].size == inside.all_receivers[0].size
    given = {name: value for name, value in target.items() if name != "kind"}  # the kind is left to its class
    made = small_spec().replace(
        target=KINDS[target["kind"]](**given, half_angle_deg=60.0)
    )  # its kind left to its class
    assert made.target == alone.target
    _require_kept(made, tmp_path)


def test_receivers_without_a_name_have_that_of_their_kind_and_a_number_where_it_needs_one() -> None:
    plane, far, named = (
        _on(PLANE, DISC),
        _on(FAR, {"kind": "beam", "fwhm_deg": 30.0}),
        {**_on(CYLINDER, DISC), "name": "wall"},
    )
    names = [receiver.name for receiver in _spec(plane, far, plane, named).all_receivers]
    assert names == ["plane_1", "far_field", "plane_2", "wall"]


def test_either_side_of_a_plane_may_be_named() -> None:
    """Light comes from the lens, so that the normal points away from it; a tilt is about x, then about y."""
    upward, downward = (
        _spec(_on({**PLANE, "normal": normal}, DISC)) for normal in ([0.0, 0.5, 2.0], [0.0, -0.5, -2.0])
    )
    assert upward.all_receivers[0].facing == downward.all_receivers[0].facing
    beside = {**PLANE, "centre_mm": [100.0, 0.0, 0.0]}
    tilted = _spec(_on({**beside, "tilt_deg": [30.0, 90.0]}, DISC)).all_receivers[0]
    assert tilted.facing == pytest.approx((np.cos(np.pi / 6), -0.5, 0.0), abs=1e-12)
    assert tilted.place == "centred at (100, 0, 0) mm, tilted by 90°"
    wall = _spec(_on({**PLANE, "tilt_deg": [0.0, -30.0]}, DISC)).all_receivers[0]
    assert wall.place == f"at {PLANE['centre_mm'][2]:g} mm, tilted by 30°"


def test_a_file_of_a_target_is_relative_to_the_folder_of_the_spec(tmp_path: Path) -> None:
    picture = {"kind": "image", "file": "cat.png", "width_mm": 80.0}
    (tmp_path / "cat.png").touch()
    for text in (_spec(_on(PLANE, picture)), _spec(target={**picture, "distance_mm": 100.0, "receiver_mm": 200.0})):
        content = text.to_toml().replace(str(Path("cat.png").resolve()), "cat.png")
        (tmp_path / "spec.toml").write_text(content, encoding="utf-8")
        loaded = lf.load_spec(tmp_path / "spec.toml")
        assert loaded.all_receivers[0].targets[0].file == tmp_path / "cat.png"


def _bad_receivers() -> list[tuple[Table, str]]:
    plane, far, cylinder, sphere = (_on(receiver, DISC) for receiver in (PLANE, FAR, CYLINDER, SPHERE))
    far["targets"] = [_in_degrees(DISC)]
    return [
        ({**plane, "centre_mm": [0.0, 0.0, 5.0]}, "distance of the plane = 5 is inside the lens: it must exceed"),
        ({**plane, "centre_mm": [0.0, 0.0, -100.0]}, "lies behind the source"),
        ({**far, "axis": [0.0, 0.0, -1.0]}, "lies behind the source"),
        ({**cylinder, "radius_mm": 6.0, "width_mm": 10.0}, "radius_mm = 6: the cylinder leaves 6 mm around the lens"),
        ({**sphere, "centre_mm": [0.0, 0.0, 95.0]}, "radius_mm = 100: the sphere leaves 5 mm around the lens origin"),
        ({**plane, "centre_mm": [100.0, 0.0, 0.0]}, "seen edge-on: it passes the lens origin at 0 mm, its centre"),
        ({**plane, "tilt_deg": [0.0, 90.0]}, "seen edge-on"),
        ({**plane, "centre_mm": [0.0, 0.0, 0.0]}, "centre_mm = (0, 0, 0) is the source; move the plane away"),
        ({**plane, "normal": [0.0, 0.0, 0.0]}, "normal = (0, 0, 0) is no direction"),
        ({**plane, "normal": [0.0, 0.0, 1.0], "tilt_deg": [0.0, 1.0]}, "normal and tilt_deg are both given"),
        ({**far, "axis": [0.0, 0.0, 0.0]}, "axis = (0, 0, 0) is no direction"),
        ({**sphere, "facing": [0.0, 0.0, 0.0]}, "facing = (0, 0, 0) is no direction"),
        ({**cylinder, "width_mm": 700.0}, "width_mm = 700 is more than once around a radius_mm of 100, 628.319"),
        ({**plane, "name": "a b"}, "name = 'a b'"),
        ({**plane, "kind": "torus"}, "receivers.0.kind = 'torus': must be one of plane, far_field"),
        ({**plane, "targets": []}, "must have at least 1 entry, not 0"),
        ({**plane, "targets": [IN_MM[8] | {"file": 7}]}, "targets.0.file = 7: must be the name of a file, in quotes"),
        (PLANE, "targets: missing"),
        ({"kind": "plane", "width_mm": 1.0, "height_mm": 1.0, "targets": [DISC]}, "centre_mm: missing"),
        ({**plane, "radius_mm": 1.0}, "radius_mm = 1.0"),
    ]  # fmt: skip


def _require_one_line(content: Table, message: str, origin: str = "spec.toml: ") -> None:
    with pytest.raises(lf.InputError) as refusal:
        parse_spec(content, "spec.toml")
    line = str(refusal.value)
    assert message in line and line.startswith(origin) and len(line.splitlines()) == 1


@pytest.mark.parametrize(("receiver", "message"), _bad_receivers())
def test_a_receiver_that_cannot_be_is_one_line(receiver: Table, message: str) -> None:
    _require_one_line(_content([receiver]), message, "spec.toml: receivers")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"centre_mm": [0.0, 0.0, 5.0]}, "receivers.centre_mm: distance of the plane = 5 is inside the lens"),
        ({"centre_mm": [0.0, 0.0, -100.0]}, "lies behind the source"),
        ({"targets": [{**DISC, "diameter_mm": 160.0}]}, "is off the receiver, which reaches 100 in x and 75 in y"),
    ],
)
def test_the_second_of_two_receivers_must_fit_the_lens_and_its_target_too(change: Table, message: str) -> None:
    first, second = ({**_on(PLANE, DISC), "name": name} for name in ("first", "second"))
    _require_one_line(_content([first, {**second, **change}]), message)


BAD_TARGETS: list[tuple[Table, Table, str]] = [
    (PLANE, {**DISC, "centre_mm": [101.0, 0.0]}, "centre_mm = (101, 0) is off the receiver, which reaches 100 in x"),
    (FAR, {"kind": "disc", "diameter_deg": 9.0, "centre_deg": [0.0, 61.0]}, "centre_deg = (0, 61) is off the receiver"),
    (PLANE, {"kind": "disc", "diameter_deg": 9.0}, "a disc in deg, on this receiver lengths are in mm"),
    (FAR, DISC, "a disc in mm, on this receiver lengths are in degrees"),
    (SPHERE, {"kind": "beam", "fwhm_deg": 9.0}, "a beam in deg, on this receiver lengths are in mm"),
    (PLANE, {**DISC, "edge_deg": 1.0}, "diameter_mm is given among lengths in deg; give diameter_deg"),
    (PLANE, {"kind": "disc"}, "diameter_mm: missing; give it, in mm"),
    (FAR, {"kind": "batwing"}, "to_deg: missing; give it, in degrees"),
    (FAR, {"kind": "camera", "width_deg": 161.0, "height_deg": 5.0}, "a rectilinear camera sees 160 degrees at most"),
    (PLANE, {**DISC, "distance_mm": 100.0, "receiver_mm": 50.0}, "lies on that receiver; leave it out"),
    (FAR, {"kind": "beam", "fwhm_deg": 9.0, "half_angle_deg": 50.0}, "lies on that receiver; leave it out"),
    (PLANE, {**DISC, "uniform_mm": 160.0}, "uniform_mm = 160 must not exceed the receiver's 200 x 150 mm"),
    (PLANE, {**DISC, "uniform_mm": [10.0, 160.0]}, "uniform_mm = (10, 160) must not exceed the receiver's"),
    (PLANE, {**DISC, "edge_mm": 250.0}, "edge_mm = 250 must not exceed the receiver's 200 x 150 mm"),
    (PLANE, {"kind": "ring", "outer_diameter_mm": 9.0, "inner_diameter_mm": 9.0}, "inner_diameter_mm = 9 must be"),
    (FAR, {"kind": "ring", "outer_diameter_deg": 8.0, "inner_diameter_deg": 9.0}, "than outer_diameter_deg = 8"),
    (PLANE, {"kind": "polygon", "corners_mm": [[0.0, 0.0], [1.0, 1.0]]}, "2 corners, a polygon has three at least"),
    (PLANE, {"kind": "polygon", "corners_mm": [[9.0, 0.0], [10.0, 1.0], [11.0, 2.0]]}, "all lie on a line"),
    (PLANE, {"kind": "spots", "columns": 2, "diameter_mm": 5.0, "pitch_mm": 4.0}, "pitch_mm = 4 is less than"),
    (FAR, {"kind": "beam", "fwhm_deg": 30.0, "edge_deg": 2.0}, 'edge_deg = 2 goes with profile = "flat"; leave it out'),
    (PLANE, {"kind": "star"}, "kind = 'star': must be one of flat_top"),
]  # fmt: skip


@pytest.mark.parametrize(("receiver", "target", "message"), BAD_TARGETS)
def test_a_target_that_does_not_fit_its_receiver_is_one_line(receiver: Table, target: Table, message: str) -> None:
    _require_one_line(_content([_on(receiver, target)]), message, "spec.toml: receivers")


# Fields of a target at the limit of what it must lie in, one that is 1 % too large, and what is said of that.
_TURNED: Table = {"kind": "rectangle", "height_mm": 30.0, "rotation_deg": 30.0}
AT_A_LIMIT: list[tuple[Table, Table, Table, str]] = [
    (PLANE, {"kind": "rectangle", "height_mm": 9.0, "width_mm": 200.0}, {"width_mm": 202.0}, "edge at (101, 4.5) is"),
    (
        PLANE,
        {**_TURNED, "width_mm": 200.0},
        {"width_mm": 226.0},
        "edge at (-105.361, -43.5096) is off the",
    ),
    (PLANE, {"kind": "text", "text": "lux", "width_mm": 200.0}, {"width_mm": 202.0}, "edge at (101, 0) is off"),
    (PLANE, {**DISC, "centre_mm": [60.0, 0.0]}, {"centre_mm": [61.0, 0.0]}, "disc, 80 mm wide: its edge at (101, 0)"),
    (FAR, {"kind": "beam", "fwhm_deg": 120.0}, {"fwhm_deg": 121.2}, "its edge at (60.6, 0) is off the receiver"),
    (FAR, {"kind": "batwing", "to_deg": 60.0}, {"to_deg": 60.6}, "its edge at (60.6, 0) is off the receiver"),
    (FAR, {"kind": "camera", "width_deg": 119.0, "height_deg": 20.0}, {"width_deg": 120.0}, "off the receiver"),
    (FAR, {"kind": "rectangle", "width_deg": 96.0, "height_deg": 72.0}, {"width_deg": 98.0}, "at (49, 36) is off"),
]


@pytest.mark.parametrize(("receiver", "fits", "larger", "message"), AT_A_LIMIT)
def test_a_target_lies_on_its_receiver(receiver, fits, larger, message) -> None:
    """A corner of the turned rectangle at 100 cos 30 - 15 sin 30; of the far one at 60, by 3, 4 and 5."""
    parse_spec(_content([_on(receiver, fits)]), "spec.toml")
    _require_one_line(_content([_on(receiver, {**fits, **larger})]), message, "spec.toml: target")


def test_the_pattern_of_lamps_without_end_goes_on_beyond_one_period() -> None:
    lamps = {"kind": "endless", "pitch_mm": 40.0}
    target = {"kind": "rectangle", "width_mm": 90.0, "height_mm": 90.0, "distance_mm": 100.0, "receiver_mm": 40.0}
    assert _spec(target=target, lamps=lamps).of_one_lamp.lamps is None
    _require_one_line(_content([], target=target), "its edge at (45, 45) is off the receiver")


SQUARE: Table = {"distance_mm": 100.0, "receiver_mm": 100.0}


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (DISC, "target: its receiver is missing; give distance_mm and receiver_mm, or"),
        ({**DISC, "receiver_mm": 100.0}, "distance_mm: missing; a plane on the axis has both"),
        ({**DISC, **SQUARE, "half_angle_deg": 30.0}, "half_angle_deg is the far field, distance_mm"),
        ({**DISC, "half_angle_deg": 30.0}, "on the far field lengths are in degrees; give diameter_deg"),
        ({"kind": "disc", "diameter_deg": 9.0, **SQUARE}, "on a plane lengths are in mm; give diameter_mm"),
        ({**DISC, **SQUARE, "distance_mm": 5.0}, "target.distance_mm = 5 is inside the lens: it must exceed"),
        ({**DISC, **SQUARE, "centre_mm": [51.0, 0.0]}, "centre_mm = (51, 0) is off the receiver"),
        ({**DISC, **SQUARE, "uniform_mm": 101.0}, "uniform_mm = 101 must not exceed the receiver's 100 mm"),
        ({"kind": "beam", "fwhm_deg": 9.0, **SQUARE}, "half_angle_deg"),
    ],
)  # fmt: skip
def test_a_target_alone_that_cannot_be_is_one_line(target: Table, message: str) -> None:
    _require_one_line(_content([], target=target), message, "spec.toml: target")


def test_a_spec_has_a_target_or_receivers_with_names_of_their_own() -> None:
    plane, target = _on(PLANE, DISC), {**DISC, **SQUARE}
    _require_one_line(_content([plane], target=target), "target or receivers: both are given; give one")
    _require_one_line(_content([]), "target or receivers: neither is given; give one")
    twice = [{**plane, "name": "a"}, {**_on(FAR, {"kind": "beam", "fwhm_deg": 9.0}), "name": "a"}]
    _require_one_line(_content(twice), "receivers: two are called 'a'; give each a name of its own")
    _require_one_line(
        _content([{**plane, "name": "plane"}, {**_on(CYLINDER, DISC), "name": "plane"}]), "two are called"
    )
    _require_one_line(_content(17 * [plane]), "receivers = list: must have at most 16 entries, not 17")


@pytest.mark.parametrize(
    ("kind", "limits", "plane", "outside"),
    [
        ("tir", {"max_height_mm": 5.0}, {"centre_mm": [0, 0, 5.1]}, True),  # nearer than the radius, over the exit
        ("tir", {"max_height_mm": 5.0}, {"centre_mm": [0, 0, 4.9]}, False),
        ("tir", {"max_height_mm": 14.0}, {"centre_mm": [0, 0, 13.9]}, False),
        ("tir", {}, {"centre_mm": [0, 0, 8.1]}, True),  # without a height as high as it is wide
        ("reflector", {"max_height_mm": 14.0}, {"centre_mm": [0, 8.1, 20], "normal": [0, -1, 0]}, True),
        ("reflector", {"max_height_mm": 14.0}, {"centre_mm": [0, 0, 15.0], "tilt_deg": [0.0, 30.0]}, False),
        ("double", {"max_height_mm": 5.0}, {"centre_mm": [0, 0, 7.9]}, False),
    ],
)
def test_a_plane_is_outside_of_the_largest_lens_of_its_kind(kind, limits, plane, outside) -> None:
    """8 mm in radius about the axis, or about the LED: the tilted plane is 13.0 mm away, the lens reaches 16.1."""
    content = {
        "source": {"kind": "square", "side_mm": 0.5},
        "lens": {"kind": kind},
        "constraints": {"max_radius_mm": 8.0, **limits},
        "receivers": [{**PLANE, **plane, "targets": [DISC]}],
        "base": {"kind": "none"},
    }
    if outside:
        parse_spec(content, "near")
        return
    with pytest.raises(InputError, match=r"is inside the lens: it must exceed constraints\.max_radius_mm"):
        parse_spec(content, "near")
