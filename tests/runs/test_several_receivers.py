"""A whole run of a lens with receivers of two kinds: every stage knows them, and every record is read back."""

import numpy as np
import pytest
from presets import FEW
from scenes import random_surface, small_spec
from scipy.interpolate import RegularGridInterpolator

import lensforge as lf
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.scene.receiver_shapes import receivers_of
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
def test_every_stage_has_both_receivers_and_the_part_lands_its_rays_on_both(run: lf.Run) -> None:
    stray = run.find(lf.StrayLight)
    assert stray is not None
    for result in (run.light, run.proof, stray):
        assert [receiver.name for receiver in result.receivers] == ["wall", "far_field"]
    wall, far = run.light.receivers
    assert wall.map.shape == (11, 16) and far.map.shape == (16, 16), "the wall is 1.5 times as wide as high"
    assert run.light.nmse == wall.nmse and wall.uniformity is not None and far.uniformity is None
    assert far.efficiency.value > wall.efficiency.value > 0.3
    assert all(criterion.holds for criterion in run.proof.criteria), [str(c) for c in run.proof.criteria]
    assert any(criterion.key.startswith("far_field: ") for criterion in run.proof.criteria)
    for receiver in run.proof.receivers:
        assert receiver.brep is not None and receiver.brep.against_design.compared > 200
        assert receiver.against_design.rms < receiver.deviation_limit_mm


@pytest.mark.nightly("a minute")
def test_intensity_of_the_far_field_is_that_of_the_photometric_file(run: lf.Run) -> None:
    """The same candela by two ways: pixels of equal solid angle, and the goniometer's grid of the IES file."""
    photometry, far = run.find(lf.Photometry), lf.evaluate(run.lens, rays=2**20).receivers[1]
    assert photometry is not None
    receiver = receivers_of(run.spec, 16)[1]
    x, y, z = np.moveaxis(receiver.places(*np.meshgrid(receiver.grid.x(), receiver.grid.y())), -1, 0)
    c_deg = np.degrees(np.arctan2(-y, x)) % 360.0  # a file's C runs from x to -y
    table = RegularGridInterpolator((photometry.c_deg, photometry.gamma_deg), photometry.candela)
    inside = receiver.window.pixels(receiver.grid) & (z > 0.2)
    stated = table(np.stack([c_deg, np.degrees(np.arccos(z))], axis=-1)[inside])
    seen = far.raw_map[inside] * photometry.source_lm / photometry.source_w
    assert seen.sum() == pytest.approx(stated.sum(), rel=0.01)
    bright = stated > 0.3 * stated.max()
    assert bright.sum() > 20 and np.allclose(seen[bright], stated[bright], rtol=0.1)


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
