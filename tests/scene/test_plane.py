"""Exit rays on the plane at right angles to the axis, against closed forms; and the receivers that specs describe."""

import numpy as np
import pytest
import torch
from scenes import small_spec

from lensforge.kernels.fate import Fate
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver import Hits, ReceiverPose
from lensforge.scene.receiver_shapes import Cylinder, Dome, FarField, Plane, receivers_of
from lensforge.spec import Spec

RECEIVER = Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 100.0)), PixelGrid.square(300.0, 32))
DISC = {"kind": "disc", "diameter_mm": 20.0}


def _exits(count: int = 2000) -> ExitRays:
    """Exit rays in every direction, some of which did not leave the lens."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:4, 2] = [0.0, 1e-12, 1e-11, -1e-3]
    fates = rng.choice([Fate.LEFT_LENS, Fate.LEFT_LENS, Fate.LEFT_LENS, Fate.BASE, Fate.TOTAL_REFLECTION], count)
    fates[:4] = Fate.LEFT_LENS
    left = fates == Fate.LEFT_LENS
    points = rng.uniform(-3.0, 3.0, (count, 3)) * left[:, None]
    arrays = points, directions * left[:, None], rng.random(count), rng.random(count), fates.astype(np.int8)
    return ExitRays(*(torch.from_numpy(array) for array in arrays))


def _spec(*receivers: dict, **changes: object) -> Spec:
    return small_spec(target=None, receivers=list(receivers), **changes)


def test_rays_land_where_their_lines_meet_the_plane() -> None:
    exits = _exits()
    landings = RECEIVER.land(exits)
    landed, rise = landings.landed, exits.directions[:, 2]
    assert 500 < landed.sum() < 1000
    assert torch.equal(landed, exits.left_lens & (rise > 1e-12))
    assert torch.equal(landings.missed_receiver, exits.left_lens & ~landed)
    assert landings.missed_receiver[:4].tolist() == [True, True, False, True]
    across = torch.cat([landings.hits, torch.full_like(landings.hits[:, :1], 100.0)], dim=1) - exits.points
    off_line = torch.linalg.cross(across, exits.directions)[landed & (rise > 1e-3)]
    assert off_line.abs().max() < 1e-9
    assert torch.equal(landings.flux, exits.flux * landed)
    assert not landings.hits[~landed].any()


def test_hits_are_the_landings_of_some_of_the_rays() -> None:
    landings = RECEIVER.land(_exits())
    hits, rows = Hits.of(landings), np.array([5, 3, 1999])
    assert np.array_equal(hits.arrived, landings.landed.numpy())
    assert np.array_equal(hits.take(rows).hits, landings.hits.numpy()[rows])
    assert np.array_equal(hits.take(slice(3)).flux, landings.flux.numpy()[:3])


def test_a_target_alone_stands_on_a_plane_or_in_the_far_field() -> None:
    spec = small_spec(evaluate__window_mm=150.0)
    (found,) = receivers_of(spec, 64)
    side, distance = spec.target.receiver_mm, spec.target.distance_mm  # type: ignore[union-attr]
    assert found == Plane(
        ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance)), PixelGrid.square(side, 64), Window(150.0, 150.0)
    )
    assert found.pixel_measure == pytest.approx((side / 64 * 1e-3) ** 2)
    beam = small_spec(target={"kind": "beam", "fwhm_deg": 30.0, "half_angle_deg": 60.0})
    (far,) = receivers_of(beam, 64)
    assert isinstance(far, FarField) and far.grid.shape == (64, 64) and far.grid.size == pytest.approx((2.0, 2.0))
    assert far.window.radius == pytest.approx(1.0) and far.window.width == np.inf


def test_receivers_of_a_spec_are_as_it_says() -> None:
    wall = {"kind": "plane", "centre_mm": [60.0, 0.0, 80.0], "normal": [-1.0, 0.0, 0.0], "targets": [DISC]}
    found = receivers_of(
        _spec(
            {**wall, "width_mm": 200.0, "height_mm": 100.0, "window_mm": [50.0, 40.0]},
            {"kind": "cylinder", "radius_mm": 90.0, "width_mm": 100.0, "height_mm": 50.0, "targets": [DISC]},
            {"kind": "sphere", "radius_mm": 90.0, "half_angle_deg": 60.0, "targets": [DISC], "pixel_aspect": 2.0},
        ),
        64,
    )
    plane, cylinder, sphere = found
    assert isinstance(plane, Plane) and np.allclose(plane.pose.axes[2], [1.0, 0.0, 0.0]), "away from the lens"
    assert (plane.grid.columns, plane.grid.rows, plane.window) == (64, 32, Window(50.0, 40.0))
    assert isinstance(cylinder, Cylinder) and cylinder.grid.size == (100.0, 50.0)
    assert isinstance(sphere, Dome) and sphere.window.radius == pytest.approx(90.0)
    assert sphere.grid.size == pytest.approx((180.0, 180.0)) and (sphere.grid.columns, sphere.grid.rows) == (32, 64)
