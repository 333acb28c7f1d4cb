"""A part with a known form error, measured with noise, corrected, and cut again with the same error."""

import numpy as np
import pytest
from known_shapes import OfRadius
from measured_lenses import directions, lens
from nightly import first_by_day
from second_cuts import CutAgain, cosine, machine_error, measured, without_motion

import lensforge as lf
from lensforge.addons.measure.areal_filter import ArealFilter, ChangedSurface, PointDeviations
from lensforge.addons.measure.correction import limited_by_cutter
from lensforge.addons.measure.first_cut import FirstCut, Request
from lensforge.addons.measure.measured_surface import ChangedLens
from lensforge.cad.patch import fit_patch
from lensforge.errors import InputError
from lensforge.shop.face_samples import AirSide, OpticalFace, sample_face
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.srbf import fibonacci_hemisphere

LENS = lens()
RADIUS = {"inner": 6.0, "outer": 13.0}
POINTS = {"inner": 3200, "outer": 8000}


def error_of(side, wave_mm=2.5):
    return lambda u: machine_error(u, RADIUS[side], wave_mm=wave_mm)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module")
def corrected(tmp_path_factory):
    """A correction of one face by its points, and the error along the normal (um) of the first and the second cut."""
    made = {}

    def run(side, registration="none", **settings):
        key = side, registration, *settings.items()
        if key not in made:
            of, error, file = getattr(LENS, side), error_of(side), tmp_path_factory.mktemp("cut") / "points.csv"
            if registration == "rigid":  # what is motion is pose, and no form that a correction could know
                error = without_motion(of, error)
            np.savetxt(file, measured(of, error, POINTS[side]), delimiter=",")
            correction = lf.correct(LENS, points=file, surface=side, registration=registration, **settings)
            made[key] = correction, CutAgain(correction.step, side, of, error), error
        return made[key]

    return run


@pytest.mark.parametrize(
    ("side", "registration"),
    first_by_day(1, [("inner", "rigid"), ("outer", "none"), ("outer", "rigid"), ("inner", "none")]),
)
def test_the_second_cut_is_within_a_micrometre(corrected, side, registration):
    """The oracle reads the STEP by the CAD kernel, and adds the machine's error to it."""
    correction, again, error = corrected(side, registration)
    u = directions(20000, 77)
    first = 1e3 * error(u) * cosine(getattr(LENS, side), u)
    second = 1e3 * again.along_normals(u)
    assert np.abs(first).max() > 3.5
    assert rms(second) < 0.2 and np.abs(second).max() < 1.0
    assert correction.deviation_um.rms == pytest.approx(rms(first), rel=0.05)
    assert correction.noise_rms_um == pytest.approx(0.3, rel=0.15)
    assert correction.expected_um.rms == pytest.approx(rms(second), rel=0.3)
    assert [str(criterion) for criterion in correction.criteria if not criterion.holds] == []


@pytest.mark.parametrize("side", first_by_day(1, ["inner", "outer"]))
def test_the_second_cut_has_the_light_of_the_design(corrected, side):
    correction, again, error = corrected(side, "none" if side == "outer" else "rigid")
    # The outer face moves half as much light: less than 2^17 rays see. What it moves lowers the NMSE of this lens,
    # which is that of no search.
    rays = {"inner": 2**17, "outer": 2**19}[side]
    leds = {"": build_source(LENS.spec.source)}
    cuts = ChangedLens(LENS, side, leds, PRESETS["draft"].evaluate_nodes_per_sigma, rays)
    design, first, second = cuts.lights(None, OfRadius(error, 0.05), again)[""]
    changes = [light.replicates.change_from(design.replicates) for light in (first, second)]
    uncorrected, left, lost = changes[0].nmse, changes[1].nmse, changes[1].efficiency
    assert abs(uncorrected.value) > 3.0 * uncorrected.standard_error
    assert abs(left.value) <= 2.0 * design.metrics.nmse.standard_error
    assert abs(lost.value) <= 2.0 * design.metrics.efficiency.standard_error
    # Common rays see less than that: with 2^20 of them 0.00047 of the first cut, 0.00007 +- 0.00002 of the second.
    assert abs(left.value) <= 0.2 * abs(uncorrected.value) + 2.0 * left.standard_error
    off = [np.sum((cut.map - design.map) ** 2) for cut in (first, second)]
    assert off[1] < 0.1 * off[0]
    assert abs(correction.change.nmse.value) <= 3.0 * correction.change.nmse.standard_error


@pytest.mark.nightly("four seconds; by day a whole gain")
def test_half_a_gain_leaves_half(corrected):
    correction, again, error = corrected("inner", "rigid", gain=0.5, wavelength_mm=1.5, rays=64)
    u = directions(5000, 5)
    first = error(u) * cosine(LENS.inner, u)
    assert np.polyfit(first, again.along_normals(u), 1)[0] == pytest.approx(0.515, abs=0.02)  # of the wave, 0.885 pass
    assert correction.expected_um.rms == pytest.approx(1e3 * rms(again.along_normals(u)), rel=0.1)
    assert correction.gain == 0.5 and correction.wavelength_given and correction.conditions.rays == 64


def test_a_motion_of_the_part_is_no_correction():
    """A perfect part that lies askew in the measuring machine; by datums the same points are an error of form."""
    u = directions(3000, 3)
    cloud = u * LENS.inner.radius(u)[:, None] + np.array([0.02, -0.01, 0.03])
    cuts = {
        registration: FirstCut.of(LENS.inner, fit_patch(LENS.inner), cloud, Request(1.5, registration=registration))
        for registration in ("rigid", "none")
    }
    assert np.abs(cuts["rigid"].chosen.change.radius(u)).max() < 2e-5
    np.testing.assert_allclose(cuts["rigid"].placed.motion.translation_mm, (-0.02, 0.01, -0.03), atol=1e-4)
    shifted = np.abs(cuts["none"].chosen.change.radius(u)).max()
    assert shifted == pytest.approx(np.linalg.norm([0.02, -0.01, 0.03]), rel=0.05)


def concave_mm(face):
    return -1.0 / sample_face(face, 161).lowest_curvature()


def test_a_cutter_that_only_just_fits_the_design_fits_the_correction():
    """The design's smallest concave radius is the ball's own: a wave of 5 um on it would be too tight."""
    surface, u = LENS.inner, fibonacci_hemisphere(3000)
    face = OpticalFace(fit_patch(surface), AirSide.INSIDE)
    tightest = concave_mm(face)
    filtered = ArealFilter(PointDeviations(surface, u, machine_error(u, RADIUS["inner"], 5e-3)), 2.0).solve()
    free, bound = (limited_by_cutter(surface, face, filtered, 1.0, ball) for ball in (0.5 * tightest, tightest))

    def corrected_mm(made):
        return concave_mm(OpticalFace(fit_patch(ChangedSurface(surface, made.change)), face.air))

    assert free.smoothed_more_share == 0.0 and corrected_mm(free) < 0.95 * tightest
    assert 0.005 < bound.smoothed_more_share < 0.6 and corrected_mm(bound) > 0.998 * tightest
    half = limited_by_cutter(surface, face, filtered, 0.5, tightest)
    assert half.smoothed_more_share > 0.0
    np.testing.assert_allclose(half.change.radius(u), -0.5 * half.filtered.change.radius(u), atol=1e-12)
    # Cut back where it must be, and nowhere else.
    taken = 1e3 * np.abs(bound.change.radius(u) - free.change.radius(u))
    assert 0.5 < taken.max() < 20.0 and np.median(taken) < 0.1 * taken.max()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wavelength_mm": 0.1}, r"wavelength_mm = 0\.1: must be from 1\.\d+ \(three spacings of the points"),
        ({"wavelength_mm": "fine"}, "wavelength_mm = 'fine': a finite number"),
        ({"gain": 0.0}, "gain = 0: must be above 0 and at most 2"),
        ({"gain": 3.0}, "gain = 3: must be above 0 and at most 2"),
        ({"surface": "base"}, "surface = 'base': must be one of inner, outer"),
        ({"registration": "loose"}, "registration = 'loose': must be one of rigid, shift, none"),
        ({"points": None}, "correct: give one of two"),
        ({"points": "nowhere.csv"}, "nowhere.csv: no such file"),
    ],
)
def test_bad_input_is_one_line(tmp_path, settings, message):
    np.savetxt(tmp_path / "points.csv", measured(LENS.inner, error_of("inner"), 1500), delimiter=",")
    given = {"points": tmp_path / "points.csv", "surface": "inner"} | settings
    with pytest.raises(InputError, match=message) as caught:
        lf.correct(LENS, **given)
    assert "\n" not in str(caught.value)
