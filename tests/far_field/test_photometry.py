"""Light behind the lens: straight through spheres, the same rays that the tracer sees, and no flux lost on the way."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import random_surface, small_spec, sphere

from lensforge.accuracy import PRESETS
from lensforge.errors import InputError
from lensforge.evaluation.simulate import TracedLens
from lensforge.far_field.export import measure_photometry
from lensforge.far_field.intensity import AngularGrid, exit_rays
from lensforge.far_field.photometry import Photometry
from lensforge.kernels.fates import Fate
from lensforge.lens import Lens
from lensforge.optics.materials import normal_transmittance
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.plane import PlaneReceiver
from lensforge.sources.build import build_source
from lensforge.sources.bundle import RayBundle
from lensforge.sources.photometric import read_photometric
from lensforge.sources.qmc import sobol
from lensforge.sources.rayfiles import read_rayfile
from lensforge.sources.square import SquareEmitter

ROUGH = Lens(random_surface(1, 3.0, 0.01), random_surface(2, 6.0, 0.01), small_spec(), seed=0, accuracy="draft")
SHELL = Lens(sphere(3.0), sphere(6.0), small_spec(), seed=0, accuracy="draft")
THROUGH = normal_transmittance(1.4936) ** 2


def test_exit_rays_go_where_the_tracer_says():
    """Carried on to any plane, they land where the tracer lands them; they start on the sphere, outwards."""
    traced = TracedLens.of(ROUGH, 4.0)
    rays = SquareEmitter(1.0).sample(4096, 3)
    out = exit_rays(traced, rays, 7.0)
    third = PlaneReceiver(321.0, PixelGrid(100.0, 10)).land(traced.trace(rays))
    arrived = third.landed.numpy()
    start, way = out.rays.origins, out.rays.directions
    landed = start + way * ((321.0 - start[:, 2]) / way[:, 2])[:, None]
    np.testing.assert_allclose(landed[:, :2], third.hits.numpy()[arrived], rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(start, axis=1), 7.0, rtol=1e-9)
    assert (np.sum(start * way, axis=1) > 0.0).all()
    np.testing.assert_array_equal(out.rays.flux, third.flux.numpy()[arrived])
    assert out.by_fate_w[Fate.LEFT_LENS] == pytest.approx(out.rays.flux.sum())


def test_a_point_source_in_concentric_spheres_is_seen_as_it_is():
    traced = TracedLens.of(SHELL, 4.0)
    rays = SquareEmitter(0.0).sample(2**16, 1)
    out = exit_rays(traced, rays, 6.1)
    np.testing.assert_allclose(out.rays.directions, rays.directions, atol=1e-9)
    np.testing.assert_allclose(out.rays.origins, 6.1 * rays.directions, atol=1e-8)
    table = AngularGrid(8, 30).table(AngularGrid(8, 30).deposit(out.rays))
    expected = THROUGH / np.pi * np.cos(np.deg2rad(table.gamma_deg))
    np.testing.assert_allclose(table.values[3, :-3], expected[:-3], rtol=0.01)
    assert table.flux() == pytest.approx(THROUGH, rel=1e-9)


def _aimed(directions, weights):
    return RayBundle(np.zeros_like(directions), directions, weights)


@pytest.mark.parametrize(("planes", "steps"), [(72, 90), (7, 5), (1, 1)])
def test_no_flux_is_lost_between_rays_and_table(planes, steps):
    random = np.random.default_rng(5)
    directions = random.normal(size=(500, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions[:3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]  # the axis, the horizon, a seam
    weights = random.uniform(0.1, 2.0, 500)
    grid = AngularGrid(planes, steps)
    flux = grid.deposit(_aimed(directions, weights))
    assert flux.sum() == pytest.approx(weights.sum(), rel=1e-12)
    assert grid.table(flux).flux() == pytest.approx(weights.sum(), rel=1e-12)


def test_the_table_converges_to_the_intensity_with_the_square_of_its_step():
    """A beam 30 degrees off the axis, I = exp(-(angle / 20 deg)^2), by weights of a uniform hemisphere of rays."""
    points = sobol(2**19, 2, 2)
    sine, azimuth = np.sqrt(1.0 - points[:, 0] ** 2), 2.0 * np.pi * points[:, 1]
    directions = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), points[:, 0]], axis=1)
    beam = np.array([0.5, 0.0, np.sqrt(0.75)])

    def intensity(ways):
        return np.exp(-((np.arccos(np.clip(ways @ beam, -1.0, 1.0)) / np.deg2rad(20.0)) ** 2))

    rays = _aimed(directions, intensity(directions) * (2.0 * np.pi / len(directions)))
    errors = []
    for planes, steps in ((18, 15), (36, 30)):
        table = AngularGrid(planes, steps).table(AngularGrid(planes, steps).deposit(rays))
        c, gamma = np.deg2rad(table.c_deg[:, None]), np.deg2rad(table.gamma_deg[None])
        ways = np.stack(np.broadcast_arrays(np.sin(gamma) * np.cos(c), np.sin(gamma) * np.sin(c), np.cos(gamma)), -1)
        inner = slice(2, -1)  # few rays fall to the nodes about the axis
        errors.append(np.sqrt(np.mean((table.values - intensity(ways))[:, inner] ** 2)))
    assert np.log2(errors[0] / errors[1]) > 1.7


def measured(lens, **options):
    return measure_photometry(lens, build_source(lens.spec.source), PRESETS[lens.accuracy], **options)


def test_the_files_hold_the_light_and_every_loss_is_named(tmp_path):
    found = measured(ROUGH, rays=2**14, lumens=250.0)
    found.write(tmp_path)
    assert Photometry.read(tmp_path) == found
    assert found.inputs == {"lens": ROUGH.sha256}
    assert all(criterion.passed for criterion in found.criteria)
    assert len(found.criteria) == 3
    assert found.exit_w.value + sum(found.lost_w.model_dump().values()) + found.reflected_w == pytest.approx(1.0)
    assert found.exit_lm == pytest.approx(250.0 * found.exit_w.value)
    assert 0.0 < found.exit_w.standard_error < 1e-3
    for name in ("lens.ies", "lens.ldt"):
        photometric = read_photometric(tmp_path / name)
        assert photometric.intensity.flux() == pytest.approx(found.exit_lm, rel=1e-6)
        assert photometric.intensity.values.max() == pytest.approx(found.peak_cd, rel=1e-6)
        np.testing.assert_allclose(photometric.intensity.values, found.candela, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(photometric.intensity.gamma_deg, found.gamma_deg)
        assert photometric.lamp_lumens == 250.0


def test_nothing_is_written_unless_it_is_saved(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = measured(SHELL, rays=1024)
    assert list(tmp_path.iterdir()) == []
    for suffix, content in ((".ies", found.ies), (".ldt", found.ldt), (".tm25ray", found.tm25)):
        found.save(tmp_path / f"other{suffix}")
        assert (tmp_path / f"other{suffix}").read_bytes() == content
    with pytest.raises(InputError, match="a Photometry is saved as one of"):
        found.save(tmp_path / "other.xyz")


def test_the_ray_file_is_the_light_that_the_tracer_sees(tmp_path):
    """Means over the receiver's plane of the file's rays, and of the tracer's for other rays of the same source."""
    measured(ROUGH, rays=2**14).save(tmp_path / "lens.tm25ray")
    rayfile = read_rayfile(tmp_path / "lens.tm25ray")
    start, way = rayfile.positions_mm.astype(float), rayfile.directions.astype(float)
    landed = (start + way * ((100.0 - start[:, 2]) / way[:, 2])[:, None])[:, :2]
    exits = TracedLens.of(ROUGH, 6.0).trace(build_source(ROUGH.spec.source).sample(2**15, 77))
    seen_there = PlaneReceiver(100.0, PixelGrid(100.0, 10)).land(exits)
    hits, flux = seen_there.hits.numpy(), seen_there.flux.numpy()
    for axis in (0, 1):
        seen = np.tanh(hits[:, axis] / 80.0 + 0.3) @ flux
        assert np.tanh(landed[:, axis] / 80.0 + 0.3) @ rayfile.flux == pytest.approx(seen, abs=2e-3)
    assert rayfile.stated_flux == pytest.approx(flux.sum(), rel=2e-3)


def test_the_lumens_of_the_source_come_from_its_efficacy():
    bright = small_spec(source__luminous_efficacy_lm_per_w=300.0, source__flux_w=2.0)
    found = measured(replace(SHELL, spec=bright), rays=1024)
    assert found.source_lm == 600.0
    assert found.light_output_ratio.value == pytest.approx(0.5 * found.exit_w.value)
    assert found.light_output_ratio.standard_error == pytest.approx(0.5 * found.exit_w.standard_error)
    assert found.exit_lm == pytest.approx(600.0 * found.light_output_ratio.value)


@pytest.mark.parametrize("lumens", [0.0, -5.0, np.nan, np.inf])
def test_lumens_that_are_none_are_one_line(lumens):
    with pytest.raises(InputError, match=r"lumens = .*: must be above 0"):
        measured(SHELL, rays=64, lumens=lumens)


def test_a_lens_that_lets_no_light_out_has_no_photometry():
    crossed = replace(SHELL, inner=sphere(6.0), outer=sphere(3.0))  # everywhere
    with pytest.raises(InputError, match="no light"):
        measured(crossed, rays=64)
