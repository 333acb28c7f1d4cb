"""The symmetry that a scene has is found, and none that it has not; light is mirrored pixel by pixel."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver, ReceiverPose
from lensforge.scene.receiver_shapes import Cylinder, Dome, FarField, Plane
from lensforge.search.optimiser import search
from lensforge.search.symmetry import _has_mirrors, chart_mirrors, mirrored_light, settled_symmetry
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.planar_emitter import planar_emitter
from lensforge.spec import Spec
from lensforge.spec.source_sections import RectangleSource
from lensforge.surfaces.mirror_group import generators

UP, SQUARE, OBLONG = (0.0, 0.0, 1.0), PixelGrid(60.0, 60.0, 6, 6), PixelGrid(60.0, 40.0, 6, 5)


def pose(rotation_deg: float = 0.0, centre: tuple[float, float, float] = (0.0, 0.0, 50.0), facing=UP) -> ReceiverPose:
    return ReceiverPose.facing(facing, centre, rotation_deg)


RECEIVERS = {
    "plane": Plane(pose(), SQUARE),
    "turned by 90": Plane(pose(90.0), SQUARE),
    "turned by 45": Plane(pose(45.0), SQUARE),
    "turned by 135": Plane(pose(135.0), SQUARE),
    "turned by 180": Plane(pose(180.0), SQUARE),
    "oblong": Plane(pose(), OBLONG),
    "oblong, turned by 90": Plane(pose(90.0), OBLONG),
    "ahead": Plane(pose(0.0, (0.0, 20.0, 40.0), (0.0, 0.5, 1.0)), OBLONG),
    "ahead, turned": Plane(pose(90.0, (0.0, 20.0, 40.0), (0.0, 0.5, 1.0)), OBLONG),
    "far field": FarField(pose(90.0, (0.0, 0.0, 0.0)), PixelGrid(1.2, 1.2, 6, 6)),
    "cylinder": Cylinder(pose(0.0, (0.0, 0.0, 0.0)), SQUARE, radius_mm=50.0),
    "sphere": Dome(pose(0.0, (0.0, 0.0, 0.0)), SQUARE, radius_mm=50.0),
}


def by_places(receiver: PosedReceiver, image: np.ndarray, mirror: np.ndarray) -> np.ndarray | None:
    """The mirror image of light on a receiver, by the nearest pixel to each mirrored place; None where one has none."""
    places = receiver.places(*np.meshgrid(receiver.grid.x(), receiver.grid.y())).reshape(-1, 3)
    away = np.linalg.norm((places @ mirror)[:, None] - places, axis=2)
    nearest = away.argmin(axis=1)
    if away.min(axis=1).max() > 1e-9:
        return None
    return np.asarray(image.ravel()[nearest].reshape(image.shape))


@pytest.mark.parametrize("name", list(RECEIVERS))
@pytest.mark.parametrize("symmetry", ["none", "mirror_x", "mirror_y", "rectangle", "square"])
def test_light_is_mirrored_to_the_pixels_of_the_mirrored_places(name: str, symmetry: str) -> None:
    receiver = RECEIVERS[name]
    found = chart_mirrors(receiver, symmetry)
    wanted = np.random.default_rng(0).random(receiver.grid.shape)
    image = torch.from_numpy(wanted)
    for mirror in generators(symmetry):
        other = by_places(receiver, wanted, mirror)
        if other is None:
            assert found is None
            return
        wanted = 0.5 * (wanted + other)
    assert found is not None
    np.testing.assert_allclose(mirrored_light(image, found).numpy(), wanted, atol=1e-15)


@pytest.mark.parametrize(
    ("receiver", "same"),
    [
        (Plane(pose(centre=(0.4e-7, 0.0, 100.0)), SQUARE), True),  # it moves by twice of that
        (Plane(pose(centre=(0.6e-7, 0.0, 100.0)), SQUARE), False),
        (Plane(pose(1e-9), SQUARE), True),
        (Plane(pose(1e-7), SQUARE), False),
        (replace(RECEIVERS["far field"], pose=pose(30.0, (0.0, 0.0, 0.0))), False),
        (replace(RECEIVERS["far field"], pose=pose(0.0, (0.0, 0.0, 0.0), (0.1, 0.0, 1.0))), False),
    ],
)
def test_frames_are_mirrored_to_themselves_but_for_rounding(receiver: PosedReceiver, same: bool) -> None:
    assert (chart_mirrors(receiver, "mirror_x") is not None) == same


@pytest.mark.parametrize("grid", [PixelGrid(60.0, 60.0, 6, 5), PixelGrid(60.0, 50.0, 6, 6)])
def test_x_and_y_are_swapped_only_on_a_square_of_square_pixels(grid: PixelGrid) -> None:
    assert chart_mirrors(Plane(pose(), grid), "square") is None
    assert chart_mirrors(Plane(pose(), grid), "rectangle") is not None


def test_a_picture_has_a_mirror_image_that_is_the_same_to_a_millionth_of_its_maximum() -> None:
    mirrors, image = (((-1, 0), (0, 1)),), np.array([[1.0, 5.0, 1.0], [0.0, 2.0, 0.0]]) / 100.0
    assert _has_mirrors(image, mirrors) and not _has_mirrors(image, None)
    for change, same in ((0.05e-6, True), (0.5e-6, False)):
        off = image.copy()
        off[1, 0] += change
        assert _has_mirrors(off, mirrors) == same, "beside a pixel of 0.05 W"
    bright = image.copy()
    bright[0, 0] += 0.5e-7
    assert _has_mirrors(bright, mirrors)
    assert not _has_mirrors(image, (((1, 0), (0, -1)),))


@pytest.mark.parametrize(
    ("symmetry", "side", "words"),
    [
        ("square", "source", "the source has only 'rectangle'"),
        ("square", "target", "the target is not symmetric in this way"),
        ("mirror_x", "target", "the target is not symmetric in this way"),
    ],
)
def test_a_symmetry_that_the_scene_lacks_is_refused(symmetry: str, side: str, words: str) -> None:
    target = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    if side == "target":
        target["height_mm"] = 30.0
    if symmetry == "mirror_x":
        target["centre_mm"] = [20.0, 0.0]

    spec = small_spec(target=target, lens__symmetry=symmetry)
    with pytest.raises(InputError, match=words):
        settled_symmetry(spec, LONG if side == "source" else SquareEmitter(1.0))
    allowed = spec.replace({"lens.symmetry": "mirror_y"})
    assert settled_symmetry(allowed, LONG) is allowed
    found = settled_symmetry(spec.replace({"lens.symmetry": "auto"}), SquareEmitter(1.0)).lens.symmetry
    assert found == {"source": "square", "target": "mirror_y" if symmetry == "mirror_x" else "rectangle"}[side]


@pytest.mark.parametrize(
    ("limit", "symmetry"),
    [
        ({"kind": "points", "at_mm": [[20.0, 0.0]], "unit": "lx", "at_least": 1.0}, "mirror_y"),
        ({"kind": "zone", "at_least_share": 0.5}, "square"),
        ({"kind": "zone", "zone": {"kind": "rectangle", "width_mm": 100.0, "height_mm": 40.0}, "at_least_share": 0.5},
         "rectangle"),
    ],
)  # fmt: skip
def test_a_lens_has_the_symmetry_of_the_places_of_its_limits_whatever_their_unit(limit: dict, symmetry: str) -> None:
    target = {"kind": "disc", "diameter_mm": 60.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    spec = small_spec(target=target, lens__symmetry="auto", source__flux_lm=100.0).replace(limits=[limit])
    assert settled_symmetry(spec, SquareEmitter(1.0)).lens.symmetry == symmetry


PLACE = {"distance_mm": 100.0, "receiver_mm": 200.0}
LONG = planar_emitter(RectangleSource(kind="rectangle", width_mm=1.0, height_mm=0.5))


def _scene(target: dict) -> Spec:
    return small_spec(lens__symmetry="auto", optimise__pixels=64, target={**target, **PLACE})


@pytest.mark.parametrize(
    ("target", "source", "symmetry"),
    [
        ({"kind": "flat_top", "width_mm": 160.0}, SquareEmitter(1.0), "square"),
        ({"kind": "flat_top", "width_mm": 160.0}, LONG, "rectangle"),
        ({"kind": "cross", "length_mm": 120.0, "stroke_mm": 40.0}, SquareEmitter(1.0), "square"),
        ({"kind": "text", "text": "L", "width_mm": 50.0}, SquareEmitter(1.0), "none"),
        ({"kind": "text", "text": "E", "width_mm": 50.0}, LONG, "none"),  # its bars are not quite alike
    ],
)
def test_auto_is_the_largest_that_source_and_target_share(target: dict, source, symmetry: str) -> None:
    assert settled_symmetry(_scene(target), source).lens.symmetry == symmetry


def test_a_fixed_surface_limits_the_symmetry() -> None:
    inner = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -3.0, "radius_y_mm": -2.9}
    lens = {"levels": [9, 25], "fixed_inner": inner, "outer_offset_mm": 6.0}
    target = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "edge_mm": 5.0, **PLACE}
    found, wanted = (
        small_spec(optimise__pixels=64, target=target, lens=lens | {"symmetry": each}) for each in ("auto", "square")
    )
    assert settled_symmetry(found, SquareEmitter(1.0)).lens.symmetry == "rectangle"
    with pytest.raises(InputError, match=r"'square': lens.fixed_inner is not symmetric in this way"):
        settled_symmetry(wanted, SquareEmitter(1.0))


def test_a_lens_records_the_symmetry_that_was_found() -> None:
    lens = search(small_spec(lens__symmetry="auto"), SquareEmitter(1.0), accuracy="draft").lens
    assert lens.spec.lens.symmetry == "square" == lens.outer.basis.symmetry


def mirrored(**changes: Any) -> str:
    """The symmetry found for a disc on a receiver."""
    kind = changes.pop("kind", "plane")
    size = {"half_angle_deg": 60.0} if kind in ("far_field", "sphere") else {"width_mm": 200.0, "height_mm": 200.0}
    target = {"kind": "disc", "diameter_mm": 60.0}
    if kind == "far_field":
        target = {"kind": "disc", "diameter_deg": 40.0}
    target |= changes.pop("target", {})
    spec = small_spec(target=None, receivers=[{"kind": kind, "targets": [target], **size, **changes}])
    spec = spec.replace({"lens.symmetry": "auto"})
    return settled_symmetry(spec, SquareEmitter(1.0)).lens.symmetry


@pytest.mark.parametrize(
    ("changes", "symmetry"),
    [
        ({"centre_mm": [0.0, 0.0, 100.0]}, "square"),
        ({"centre_mm": [0.0, 0.0, 100.0], "rotation_deg": 90.0}, "square"),
        ({"centre_mm": [0.0, 0.0, 100.0], "height_mm": 150.0}, "rectangle"),
        ({"centre_mm": [0.0, 0.0, 100.0], "target": {"centre_mm": [20.0, 0.0]}}, "mirror_y"),
        ({"centre_mm": [40.0, 0.0, 90.0], "tilt_deg": [0.0, 30.0]}, "mirror_y"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0]}, "mirror_x"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0], "rotation_deg": 90.0}, "mirror_x"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0], "rotation_deg": 45.0}, "mirror_x"),
        ({"centre_mm": [0.0, 40.0, 90.0], "tilt_deg": [-30.0, 0.0], "rotation_deg": 30.0}, "none"),
        ({"centre_mm": [30.0, 40.0, 90.0]}, "none"),
        ({"kind": "far_field"}, "square"),
        ({"kind": "far_field", "axis": [0.2, 0.0, 1.0]}, "mirror_y"),
        ({"kind": "cylinder", "radius_mm": 80.0}, "rectangle"),
        ({"kind": "sphere", "radius_mm": 80.0}, "square"),
        ({"kind": "sphere", "radius_mm": 80.0, "centre_mm": [5.0, 0.0, 0.0]}, "mirror_y"),
    ],
)
def test_symmetry_is_found_for_every_receiver(changes: dict[str, Any], symmetry: str) -> None:
    assert mirrored(**changes) == symmetry
