"""Light behind the lens: straight through spheres, the same rays that the tracer sees, and no flux lost on the way."""

from dataclasses import replace

import numpy as np
import pytest
from known_refraction import normal_transmittance
from scenes import random_surface, small_spec, sphere

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.exit_light import exit_rays
from lensforge.light.photometry_export import measure_photometry
from lensforge.light.photometry_result import Photometry
from lensforge.light.simulation import TracedLens
from lensforge.optics.pose import Pose
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver_shapes import Plane
from lensforge.sources.build_source import SquareEmitter, build_source
from lensforge.sources.photometric import read_photometric
from lensforge.sources.rayfiles.ray_file_io import read_rayfile
from lensforge.spec.accuracy import PRESETS
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere

ROUGH = Lens.double(random_surface(1, 3.0, 0.01), random_surface(2, 6.0, 0.01), small_spec(), seed=0, accuracy="draft")
SHELL = Lens.double(sphere(3.0), sphere(6.0), small_spec(), seed=0, accuracy="draft")
_SQUARE = SrbfBasis((4,), 1.75, "square")
SYMMETRIC = replace(
    SHELL,
    surfaces={
        name: SrbfSurface(_SQUARE, np.zeros(_SQUARE.size), radius) for name, radius in (("inner", 3.0), ("outer", 6.0))
    },
)
THROUGH = normal_transmittance(1.4936) ** 2


def _plane_at(distance_mm: float) -> Plane:
    return Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance_mm)), PixelGrid.square(100.0, 10))


def test_exit_rays_go_where_the_tracer_says():
    """Carried on to any plane, they land where the tracer lands them; they start on the sphere, outwards."""
    traced = TracedLens.of(ROUGH, 4.0)
    rays = SquareEmitter(1.0).sample(4096, 3)
    out = exit_rays(traced, rays, 7.0)
    third = _plane_at(321.0).land(traced.trace(rays))
    arrived = third.landed
    start = out.rays.origins
    way = out.rays.directions
    landed = start + way * ((321.0 - start[:, 2]) / way[:, 2])[:, None]
    np.testing.assert_allclose(landed[:, :2], third.hits[arrived], rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(start, axis=1), 7.0, rtol=1e-9)
    assert (np.sum(start * way, axis=1) > 0.0).all()
    np.testing.assert_array_equal(out.rays.flux, third.flux[arrived])
    assert out.by_fate_w[Fate.LEFT_LENS] == pytest.approx(out.rays.flux.sum())


def test_figures_of_a_point_source_in_concentric_spheres_are_lambertian():
    """pi lumens per axis candela, 120 degrees of beam, 2 arccos(0.1) of field: each within its standard error."""
    photometry = measured(replace(SYMMETRIC, spec=small_spec(source__side_mm=0.0)), rays=2**18, lumens=1000.0)
    _agrees(photometry.axis_cd, 1000.0 * THROUGH / np.pi)
    _agrees(photometry.exit_lm, np.pi * photometry.axis_cd.value, photometry.axis_cd.standard_error * np.pi)
    for plane in (photometry.beam_c0, photometry.beam_c90):
        _agrees(plane.peak_cd, 1000.0 * THROUGH / np.pi)
        _agrees(plane.beam_angle_deg, 120.0)
        _agrees(plane.field_angle_deg, 2.0 * np.rad2deg(np.arccos(0.1)))
        assert plane.beam_angle_deg.standard_error < 2.0
    assert photometry.peak_direction.gamma_deg < 15.0
    assert photometry.road is None


def _agrees(metric, truth, more=0.0):
    assert abs(metric.value - truth) < 4.0 * np.hypot(metric.standard_error, more) + 1e-9 * truth


def test_a_lamp_for_an_area_needs_lumens():
    spec = small_spec(target__distance_mm=1000.0, photometry={"use": "area"})
    with pytest.raises(InputError, match="its ratings count lumens") as error:
        measured(replace(SHELL, spec=spec), rays=1024)
    assert "\n" not in str(error.value)
    photometry = measured(replace(SHELL, spec=spec), rays=2**14, lumens=5000.0)
    assert photometry.road.distribution.lateral == "V"
    zones = sum(zone["value"] for zone in photometry.road.bug.zones.model_dump().values())
    assert zones == pytest.approx(photometry.exit_lm.value, rel=1e-6)


def measured(lens, **options):
    return measure_photometry(lens, build_source(lens.spec.source), PRESETS[lens.accuracy], **options)


def test_the_files_hold_the_light_and_every_loss_is_named(tmp_path):
    dated = replace(ROUGH, spec=ROUGH.spec.replace({"manufacture.date": "2025-03-04"}))
    photometry = measured(dated, rays=2**14, lumens=250.0)
    photometry.write(tmp_path)
    assert Photometry.read(tmp_path) == photometry
    assert photometry.inputs == {"lens": dated.sha256}
    assert all(criterion.holds for criterion in photometry.criteria)
    assert len(photometry.criteria) == 4
    assert photometry.exit_w.value + sum(
        photometry.lost_w.model_dump().values()
    ) + photometry.reflected_w == pytest.approx(1.0)
    assert photometry.exit_lm.value == pytest.approx(250.0 * photometry.exit_w.value)
    assert 0.0 < photometry.exit_w.standard_error < 1e-3
    for name in ("lens.ies", "lens.ldt", "lens.iesxml"):
        photometric = read_photometric(tmp_path / name)
        assert photometric.intensity.flux() == pytest.approx(photometry.exit_lm.value, rel=1e-6)
        np.testing.assert_allclose(photometric.intensity.values, photometry.candela, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(photometric.intensity.gamma_deg, photometry.gamma_deg)
        assert photometric.lamp_lumens == 250.0
        assert photometric.issued == "2025-03-04"
        seen = ROUGH.outer.radius(fibonacci_hemisphere(4000)) * np.hypot(*fibonacci_hemisphere(4000).T[:2])
        assert photometric.opening.diameter_mm == pytest.approx(2.0 * float(seen.max()), rel=0.01)


def test_the_ray_file_is_the_light_that_the_tracer_sees(tmp_path):
    """Means over the receiver's plane of the file's rays, and of the tracer's for other rays of the same source."""
    measured(ROUGH, rays=2**14).save(tmp_path / "lens.tm25ray")
    rayfile = read_rayfile(tmp_path / "lens.tm25ray")
    start = rayfile.positions_mm.astype(float)
    way = rayfile.directions.astype(float)
    landed = (start + way * ((100.0 - start[:, 2]) / way[:, 2])[:, None])[:, :2]
    exits = TracedLens.of(ROUGH, 6.0).trace(build_source(ROUGH.spec.source).sample(2**15, 77))
    seen_there = _plane_at(100.0).land(exits)
    hits = seen_there.hits
    flux = seen_there.flux
    for axis in (0, 1):
        seen = np.tanh(hits[:, axis] / 80.0 + 0.3) @ flux
        assert np.tanh(landed[:, axis] / 80.0 + 0.3) @ rayfile.flux == pytest.approx(seen, abs=2e-3)
    assert rayfile.stated_flux == pytest.approx(flux.sum(), rel=2e-3)


def test_without_lumens_record_and_files_say_that_candela_are_relative(tmp_path):
    photometry = measured(SYMMETRIC, rays=2**16)
    photometry.write(tmp_path)
    assert (photometry.source_lm, photometry.source_lm_from, photometry.per_1000_lm) == (1000.0, "not known", True)
    assert len(photometry.warnings) == 1 and "candela are per 1000 lm of the source" in photometry.warnings[0]
    assert "[OTHER] luminous flux of the source not known: 1000 lm taken" in (tmp_path / "lens.ies").read_text()
    assert "luminous flux of the source not known" in (tmp_path / "lens.ldt").read_text().splitlines()[11]
    assert read_rayfile(tmp_path / "lens.tm25ray").header_flux_lm is None
    stated = measured(SYMMETRIC, rays=2**16, lumens=300.0)
    assert (stated.source_lm_from, stated.per_1000_lm, stated.warnings) == ("given", False, ())
    np.testing.assert_allclose(stated.candela, 0.3 * photometry.candela, rtol=1e-12)


def test_the_ray_file_has_watts_and_lumens_and_the_spectrum(tmp_path):
    wave = {"kind": "table", "wavelength_nm": [430.0, 450.0, 470.0], "weight": [0.0, 1.0, 0.5]}
    photometry = measured(replace(SHELL, spec=small_spec(source__spectrum=wave)), rays=2**14, lumens=300.0)
    photometry.save(tmp_path / "lens.tm25ray")
    rayfile = read_rayfile(tmp_path / "lens.tm25ray")
    assert rayfile.header_flux_w == pytest.approx(photometry.exit_w.value, rel=1e-6)
    assert rayfile.header_flux_lm == pytest.approx(photometry.exit_lm.value, rel=1e-6)
    (table,) = rayfile.spectral_tables
    np.testing.assert_array_equal(table.wavelengths_nm, [430.0, 450.0, 470.0])
    np.testing.assert_array_equal(table.power_density, [0.0, 1.0, 0.5])
    assert photometry.files.tm25ray.lumens == pytest.approx(photometry.exit_lm.value, rel=1e-6)
    line = measured(
        replace(SHELL, spec=small_spec(source__spectrum={"kind": "line", "wavelength_nm": 589.0})), rays=2**10
    )
    line.save(tmp_path / "lens.tm25ray")
    assert read_rayfile(tmp_path / "lens.tm25ray").single_wavelength == 589.0


def test_c_90_is_minus_y():
    """Light that leans towards +y: turned over about the x axis, the lens sends it towards C = 270."""
    leaning = replace(SHELL, spec=small_spec(source__side_mm=0.0, source__tilt_deg=[-30.0, 0.0]))
    photometry = measured(leaning, rays=2**14)
    cone = int(np.argmin(np.abs(photometry.gamma_deg - 30.0)))
    mean = np.sum(photometry.candela[:-1, cone] * np.exp(1j * np.deg2rad(photometry.c_deg[:-1])))
    assert np.rad2deg(np.angle(mean)) % 360.0 == pytest.approx(270.0, abs=2.0)
    quarter = len(photometry.c_deg) // 4
    beyond = int(np.argmin(np.abs(photometry.gamma_deg - 75.0)))  # at C = 90 below the horizon of the source
    assert (
        photometry.candela_standard_error[quarter, beyond]
        < 0.3 * photometry.candela_standard_error[3 * quarter, beyond]
    )
