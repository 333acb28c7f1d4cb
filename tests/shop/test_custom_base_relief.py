import pytest
from known_shapes import sampled, sphere

from lensforge.shop.ball_clearance import read_base_mesh
from lensforge.shop.face_samples import AirSide

DOME = 2.45


def plate(tmp_path, bore, step=0.0):
    """A wide plate under the dome: its ring at the bore rises to z = 0, the rest lies ``step`` lower."""
    import cadquery as cq

    body = cq.Workplane("XY").workplane(offset=-3.0).rect(30.0, 30.0).extrude(3.0 - step)
    body = body.union(cq.Workplane("XY").circle(DOME - 0.2).extrude(-3.0))
    body = body.cut(cq.Workplane("XY").circle(bore / 2.0).extrude(-3.0))
    cq.exporters.export(body, str(tmp_path / "clamp.step"))
    return read_base_mesh(tmp_path / "clamp.step")


def test_a_narrow_bore_is_in_the_ball_s_way_in_the_cavity(tmp_path):
    # At the rim of a hemisphere the ball's centre is in z = 0, R inside the cavity; the bore's edge is 0.2 closer.
    samples = sampled(sphere(1.5), AirSide.INSIDE, 41)
    retreat = plate(tmp_path, 2.0 * (1.5 - 0.2)).retreat_mm(samples, 0.5)
    assert retreat.max() == pytest.approx(0.2, abs=1e-3)  # the chord of the base's mesh
    assert (plate(tmp_path, 3.0).retreat_mm(samples, 0.5) < 1e-3).all()


def test_obstacles_lie_on_the_base(tmp_path):
    points = plate(tmp_path, 2.0, step=1.0).points()
    assert points.shape == (4000, 3)
    assert (points[:, 2].max(), points[:, 2].min()) == pytest.approx((0.0, -3.0), abs=1e-9)
