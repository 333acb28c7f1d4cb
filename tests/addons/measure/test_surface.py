import inspect
from dataclasses import replace

import numpy as np
import pytest
from known_shapes import OfRadius
from measured_lenses import dent, directions, lens, probed
from nightly import first_by_day
from presets import FEW
from second_cuts import cosine, motions, without_motion

from lensforge.addons.measure.first_cut import FirstCut, Request, coverage
from lensforge.addons.measure.measured_points import PartPoints
from lensforge.addons.measure.measured_surface import ChangedLens, compare_surface
from lensforge.addons.measure.measurement_result import DeviationExtent
from lensforge.addons.measure.nominal_face import FacePixels
from lensforge.cad.boundary import domain_of
from lensforge.cad.patch import fit_patch
from lensforge.errors import InputError
from lensforge.light.evaluation import evaluate_lens
from lensforge.results import Metric
from lensforge.scene.lens import Lens
from lensforge.search.profiles import ProfileParameters
from lensforge.spec import parse_spec
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.srbf import SrbfSurface, fibonacci_hemisphere

LENS = lens()
PATCH, (TRACED, _) = fit_patch(LENS.outer), ChangedLens.of(LENS, "outer", 16384)
ROTATION, SHIFT = np.array([0.03, -0.05, 0.08]), np.array([0.4, -0.3, 0.2])
HEIGHT = 0.02


@pytest.mark.parametrize("noise", first_by_day(1, [0.002, 0.0]))
def test_a_deformation_is_found_in_a_moved_cloud(noise):
    cloud = probed(LENS.outer, 3500, height_mm=HEIGHT, noise_mm=noise, rotation=ROTATION, shift=SHIFT)
    cut, u = FirstCut.of(LENS.outer, PATCH, cloud, Request()), directions(3000, 99)
    deviation = cosine(LENS.outer, u) * cut.likeliest.change.radius(u)
    wanted = cosine(LENS.outer, u) * without_motion(LENS.outer, lambda at: dent(at, HEIGHT))(u)
    error = np.sqrt(np.mean((deviation - wanted) ** 2))
    assert error < 0.02 * HEIGHT + 0.25 * noise
    assert np.corrcoef(deviation, wanted)[0, 1] > 0.99
    assert cut.left_um(cut.likeliest) == pytest.approx(1e3 * noise, abs=0.2)


def test_the_mean_square_of_the_form_is_over_the_area_of_the_face():
    """By Archimedes, n_z is uniform over the area of a sphere: the mean of n_z^2 from -1/2 to 1 is 1/4.

    Over solid angle it is 0.205, over the chart 0.162.
    """
    raised = sphere(8.0, 4.0)

    def change(u):
        normals = u * raised.radius(u)[:, None] / 8.0 - [0.0, 0.0, 0.5]
        return 4e-3 * normals[:, 2] / np.sum(normals * u, axis=1)

    pixels = FacePixels.of(fit_patch(raised))
    assert np.nansum(pixels.area_mm2) == pytest.approx(3.0 * np.pi * 8.0**2, rel=1e-3)
    height, inside = pixels.map_um(OfRadius(change)), np.isfinite(pixels.area_mm2)
    extent = DeviationExtent.of(height[inside], pixels.area_mm2[inside])
    assert extent.rms == pytest.approx(4.0 * np.sqrt(0.25), rel=5e-4)
    assert (extent.max, extent.pv) == (pytest.approx(4.0, rel=1e-6), pytest.approx(6.0, rel=1e-2))


def test_coverage_is_the_share_of_the_hemisphere():
    u = directions(40_000, 5)
    assert coverage(u, 0.05) == pytest.approx(1.0, abs=0.01)
    assert coverage(u[u[:, 0] > 0.0], 0.02) == pytest.approx(0.5, abs=0.02)


def deformed_part(height):
    """The lens with a fine random deformation (mm) on its outer surface that holds no rigid motion."""
    outer, u = LENS.outer, directions(4000, 21)
    weights = np.zeros(outer.basis.size)
    weights[-81:] = height * np.random.default_rng(8).normal(size=81)
    values, along, moves = outer.basis.evaluate(u), cosine(outer, u), motions(outer, u)
    share = np.linalg.lstsq(moves, along * (values @ weights), rcond=None)[0]
    weights -= np.linalg.lstsq(values, moves @ share / along, rcond=None)[0]
    return replace(
        LENS, surfaces={**LENS.surfaces, "outer": SrbfSurface(outer.basis, outer.weights_mm + weights, outer.offset_mm)}
    )


@pytest.mark.parametrize("registration", first_by_day(1, ["rigid", "shift", "none"]))
def test_the_light_is_that_of_the_deformed_lens(registration):
    """The oracle is the tracer on the true part."""
    part = deformed_part(0.05)
    true = evaluate_lens(part, TRACED.leds[""], FEW).map
    motion = {"rigid": {"rotation": ROTATION, "shift": SHIFT}, "shift": {"shift": SHIFT}, "none": {}}[registration]
    cloud = probed(part.outer, 3000, noise_mm=0.0005, **motion)
    comparison = compare_surface([PartPoints(cloud)], TRACED, registration)
    left, before = comparison.irradiance_measured - true, comparison.irradiance_design - true
    assert np.sum(left**2) < 0.05 * np.sum(before**2)
    assert comparison.nmse_between > 1e-3
    assert (comparison.pose.translation_x_mm == Metric(value=0.0, unit="mm")) == (registration == "none")
    assert (comparison.pose.rotation_x_deg.standard_error is None) == (registration != "rigid")


def test_a_registration_of_no_kind_is_input_error():
    bare = inspect.unwrap(compare_surface)  # without the types that only the tests check
    with pytest.raises(InputError, match="registration = 'loose': must be one of rigid, shift, none"):
        bare([PartPoints(probed(LENS.outer, 200))], TRACED, "loose")


def test_half_a_surface_is_no_face():
    cloud = probed(LENS.outer, 2500)
    with pytest.raises(InputError, match=r"points: 1[45]\.?\d* mm apart.* over all of the face"):
        compare_surface([PartPoints(cloud[cloud[:, 0] > 0.0])], TRACED)


def test_a_face_of_a_reflector_is_measured_where_it_bounds_the_cavity() -> None:
    content = {
        "source": {"kind": "square", "side_mm": 1.0},
        "lens": {"kind": "reflector", "cup": {"fixed": {"kind": "focal_conic", "vertex_mm": 2.0}}},
        "constraints": {"max_radius_mm": 11.0},
        "target": {"kind": "disc", "diameter_deg": 40.0, "half_angle_deg": 80.0},
    }
    spec = parse_spec(content, "cup")
    lens = Lens(ProfileParameters.of(spec, 2.5).start_surfaces, spec, 0, "draft")
    cup, u = lens.surfaces["cup"], domain_of(lens, "cup").held(fibonacci_hemisphere(1200))
    deviation = 2e-3 * np.cos(3.0 * np.arccos(u[:, 2]))
    area = cup.radius(u) ** 2 / (cup.normal(u) * u).sum(axis=1)
    wanted = 1e3 * np.sqrt((area * deviation**2).sum() / area.sum())
    traced, _ = ChangedLens.of(lens, "cup", 2**12)
    for amount in (1.0, 0.0):
        points = cup.radius(u)[:, None] * u + amount * deviation[:, None] * cup.normal(u)
        comparison = compare_surface([PartPoints(points)], traced, "none")
        assert comparison.covered_share == 1.0 and comparison.form_deviation_um.rms == pytest.approx(
            amount * wanted, rel=0.05
        )
        assert (comparison.nmse_between > 1e-6) == (amount > 0.0)
    assert np.isnan(comparison.deviation_um).mean() > 0.3, "nothing is measured in the mouth"
