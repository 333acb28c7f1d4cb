"""A whole run of a lens with receivers of two kinds: every stage knows them, and every record is read back."""

import pytest
from presets import FEW
from scenes import random_surface, small_spec

import lensforge as lf
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.verbs import STRAY

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


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> lf.Run:
    folder = tmp_path_factory.mktemp("runs") / "lens"
    lf.run(SPEC, folder, accuracy=FEW)
    STRAY.run(folder)
    return lf.load(folder)


@pytest.mark.nightly("a minute; by day the crooked design of roads has a plane and a far field")
def test_every_stage_has_both_receivers(run: lf.Run) -> None:
    stray = run.find(lf.StrayLight)
    assert stray is not None
    for result in (run.light, run.proof, stray):
        assert [receiver.name for receiver in result.receivers] == ["wall", "far_field"]
    wall, far = run.light.receivers
    assert wall.map.shape == (11, 16) and far.map.shape == (16, 16), "the wall is 1.5 times as wide as high"
    assert all(criterion.holds for criterion in run.proof.criteria), [str(c) for c in run.proof.criteria]


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
