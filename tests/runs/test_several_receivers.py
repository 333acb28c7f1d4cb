"""Parts of a lens with receivers of two kinds."""

import pytest
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.made.part_study import PartStudy, Recipe

WALL = {
    "kind": "plane", "name": "wall", "centre_mm": [80.0, 0.0, 60.0], "normal": [1.0, 0.0, 0.2],
    "width_mm": 240.0, "height_mm": 160.0,
    "targets": [{"kind": "rectangle", "width_mm": 120.0, "height_mm": 60.0, "uniform_mm": [60.0, 30.0]}],
}  # fmt: skip
FAR = {
    "kind": "far_field", "half_angle_deg": 75.0, "axis": [0.3, 0.0, 1.0], "share": 0.5,
    "targets": [{"kind": "beam", "fwhm_deg": 60.0}],
}  # fmt: skip
SPEC = small_spec(target=None, receivers=[WALL, FAR], optimise__steps_per_level=[20, 20], base={"kind": "none"})


def test_parts_keep_the_bounds_of_each_receiver_under_its_name() -> None:
    lens = lf.Lens.double(random_surface(1, 3.0, 0.005), random_surface(2, 6.0, 0.005), SPEC, 0, FEW)
    study = PartStudy(Recipe(lens, 4, 512, 0, 512))
    assert not SPEC.limits and {bound.metric for bound in study.bounds} <= set(study.names)
    for name in ("nmse", "share_in_target"):
        wall, far = (
            next(bound.bound for bound in study.bounds if bound.metric == f"{prefix}{name}")
            for prefix in ("", "far_field: ")
        )
        assert name == "nmse" or wall != far
    (led,) = study.leds
    shares = [share.mean() for share in led.designed.shares]
    by_many_rays = [light.share_in_target.value for light in led.designed_light.receivers]
    assert shares == pytest.approx(by_many_rays, abs=0.05) and abs(shares[0] - shares[1]) > 0.2
