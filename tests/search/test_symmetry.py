"""The symmetry that a scene has is found, and none that it has not; light is mirrored pixel by pixel."""

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.optics.pose import Pose
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import Cylinder, FarField, Plane, SphericalReceiver
from lensforge.search.parameters import chart_mirrors, mirrored_light
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.planar_emitter import planar_emitter
from lensforge.spec.source_sections import RectangleSource
from lensforge.surfaces.mirror_group import generators

UP = (0.0, 0.0, 1.0)
SQUARE = PixelGrid(60.0, 60.0, 6, 6)
OBLONG = PixelGrid(60.0, 40.0, 6, 5)


def pose(rotation_deg: float = 0.0, centre: tuple[float, float, float] = (0.0, 0.0, 50.0), facing=UP) -> Pose:
    return Pose.facing(facing, centre, rotation_deg)


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
    "sphere": SphericalReceiver(pose(0.0, (0.0, 0.0, 0.0)), SQUARE, radius_mm=50.0),
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
    mirrors = chart_mirrors(receiver, symmetry)
    wanted = np.random.default_rng(0).random(receiver.grid.shape)
    image = torch.from_numpy(wanted)
    for mirror in generators(symmetry):
        other = by_places(receiver, wanted, mirror)
        if other is None:
            assert mirrors is None
            return
        wanted = 0.5 * (wanted + other)
    assert mirrors is not None
    np.testing.assert_allclose(mirrored_light(image, mirrors).numpy(), wanted, atol=1e-15)


@pytest.mark.parametrize(
    ("symmetry", "side", "message"),
    [
        ("square", "source", "the source has only 'rectangle'"),
        ("square", "target", "the target is not symmetric in this way"),
        ("mirror_x", "target", "the target is not symmetric in this way"),
    ],
)
def test_a_symmetry_that_the_scene_lacks_is_refused(symmetry: str, side: str, message: str) -> None:
    target = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "distance_mm": 100.0, "receiver_mm": 200.0}
    if side == "target":
        target["height_mm"] = 30.0
    if symmetry == "mirror_x":
        target["centre_mm"] = [20.0, 0.0]

    spec = small_spec(target=target, lens__symmetry=symmetry)
    with pytest.raises(InputError, match=message):
        settled_symmetry(spec, LONG if side == "source" else SquareEmitter(1.0))
    allowed = spec.replace({"lens.symmetry": "mirror_y"})
    assert settled_symmetry(allowed, LONG) is allowed
    settled = settled_symmetry(spec.replace({"lens.symmetry": "auto"}), SquareEmitter(1.0)).lens.symmetry
    assert settled == {"source": "square", "target": "mirror_y" if symmetry == "mirror_x" else "rectangle"}[side]


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


def test_a_fixed_surface_limits_the_symmetry() -> None:
    inner = {"kind": "biconic", "vertex_z_mm": 3.0, "radius_x_mm": -3.0, "radius_y_mm": -2.9}
    lens = {"levels": [9, 25], "inner": {"fixed": inner}, "outer": {"offset_mm": 6.0}}
    target = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "edge_mm": 5.0, **PLACE}
    automatic, wanted = (
        small_spec(optimise__pixels=64, target=target, lens=lens | {"symmetry": symmetry})
        for symmetry in ("auto", "square")
    )
    assert settled_symmetry(automatic, SquareEmitter(1.0)).lens.symmetry == "rectangle"
    with pytest.raises(InputError, match=r"'square': lens.inner.fixed is not symmetric in this way"):
        settled_symmetry(wanted, SquareEmitter(1.0))


def test_bodies_of_a_scene_limit_the_symmetry() -> None:
    """A wall to one side of a lens that has the mirrors of a square with a tube about the axis."""
    tube = {"kind": "cylinder", "name": "tube", "radius_mm": 70.0, "bore_radius_mm": 12.0, "length_mm": 3.0,
            "centre_mm": [0.0, 0.0, 25.0]}  # fmt: skip
    wall = {"kind": "box", "name": "wall", "size_mm": [40.0, 90.0, 2.0], "centre_mm": [60.0, 0.0, 40.0]}
    target = {"kind": "rectangle", "width_mm": 60.0, "height_mm": 60.0, "edge_mm": 5.0, **PLACE}
    symmetries = {
        len(scene): settled_symmetry(
            small_spec(target=target, optimise__pixels=64, lens__symmetry="auto", scene=scene), SquareEmitter(1.0)
        ).lens.symmetry
        for scene in ([tube], [tube, wall])
    }
    assert symmetries == {1: "square", 2: "mirror_y"}
    stated = small_spec(target=target, optimise__pixels=64, lens__symmetry="rectangle", scene=[tube, wall])
    with pytest.raises(InputError, match="'rectangle': scene is not symmetric in this way"):
        settled_symmetry(stated, SquareEmitter(1.0))
