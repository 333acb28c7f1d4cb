"""Ray files that stay on disk: the light, the figures and the errors of files that are loaded, in little memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from nightly import first_by_day
from rayfile_samples import with_spectrum_numbers, with_tables
from scenes import small_spec

from lensforge.light.simulation import bundles
from lensforge.optics.material import MATERIALS
from lensforge.proof.proof_inputs import independent_rays
from lensforge.sources import ray_bundle, stored_rays
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.joined_spectrum import spectrum_of_source
from lensforge.sources.measured_rays import divided, smoothed
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.sources.ray_set_loading import load_ray_set
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile
from lensforge.spec.source_sections import RayfilePart, RayfileSource, RayfilesSource, RaySource

COUNT = 5000


@pytest.fixture
def unread(monkeypatch):
    """Leave every file of more than 100 rays on disk, and read it in blocks of a few."""

    def _unread():
        monkeypatch.setattr(stored_rays, "LOADED_RAYS", 100)
        monkeypatch.setattr(ray_bundle, "BLOCK_RAYS", 700)

    return _unread


def led(count=COUNT, seed=3, waves=False, bad=0) -> RayFile:
    """A square LED, a little off the axis, of unequal rays; some go down, and one in ``bad`` has no flux or place."""
    sample, random = SquareEmitter(2.0).sample(count, seed), np.random.default_rng(seed)
    rayfile = RayFile(
        (sample.origins + np.array([0.1, -0.2, 0.05])).astype(np.float32),
        sample.directions.astype(np.float32),
        random.uniform(0.5, 1.5, count).astype(np.float32),
        "W",
        random.uniform(420.0, 680.0, count).astype(np.float32) if waves else None,
    )
    rayfile.directions[::97, 2] *= -1.0
    if bad:
        rayfile.flux[::bad] = 0.0
        rayfile.positions_mm[5::bad, 1] = np.nan
    return rayfile


def saved(path, rayfile, format="tm25"):
    write_rayfile(path, rayfile, format)
    return path


PLACED = {"axis": "-y", "mirror": "x", "scale": 1.5, "origin": (0.5, 0.0, -1.0), "position_mm": (0.1, 0.2, 0.3)}
LINES = {"kind": "table", "wavelength_nm": [450.0, 500.0], "weight": [1.0, 2.0]}


def sources(folder):
    plain = saved(folder / "plain.tm25ray", led())
    coloured = saved(folder / "coloured.tm25ray", led(seed=4, waves=True))
    broken = saved(folder / "broken.tm25ray", led(seed=5, waves=True, bad=50))
    table = saved(folder / "table.tm25ray", with_tables(led(seed=6)))
    lumens = saved(folder / "lumens.csv", replace(led(seed=7, waves=True), flux_unit="lm"), "csv")
    numbered = folder / "numbered.tm25ray"
    numbered.write_bytes(with_spectrum_numbers(1.0 + (np.arange(COUNT) % 3 == 0)))
    two = [RayfilePart(file=saved(folder / "few.tm25ray", led(80))), RayfilePart(file=broken, flux_w=0.5)]
    given = led(waves=True)
    return {
        "plain": RayfileSource(model="rays", file=plain),
        "placed": RayfileSource(model="rays", file=plain, flux_w=2.0, **PLACED),
        "coloured": RayfileSource(model="rays", file=coloured),
        "broken": RayfileSource(model="rays", file=broken, **PLACED),
        "table": RayfileSource(model="rays", file=table),
        "lumens": RayfileSource(model="rays", file=lumens),
        "numbered": RayfileSource(model="rays", file=numbered),
        "spectrum": RayfileSource(model="rays", file=plain, spectrum=LINES),
        "two files": RayfilesSource(model="rays", files=two, flux_w=3.0),
        "arrays": RaySource(np.column_stack([given.positions_mm, given.directions, given.flux]), flux_w=1.0),
    }


NAMES = [
    "plain", "placed", "coloured", "broken", "table", "lumens", "numbered", "spectrum", "two files", "arrays",
]  # fmt: skip


def arrays(bundle):
    every = bundle.origins, bundle.directions, bundle.flux, bundle.wavelengths_nm
    return [array for array in every if array is not None]


def light(emitter, spec):
    """All that a design takes from a source, by name: lists of arrays."""
    samples = {}
    for count in (1, 300, 2000, len(emitter), len(emitter) + 50, 2 * len(emitter)):
        samples[f"sample of {count}"] = arrays(emitter.sample(count, count))
    steps, held = divided(emitter, 0.8, 7)
    first, second = divided(held, 0.5, 8)
    samples["split"] = [*arrays(steps.sample(500, 1)), *arrays(first.sample(50, 2)), *arrays(second.sample(100, 3))]
    samples["turned"] = arrays(smoothed(steps).sample(200, 3))
    for count in (3000, len(emitter)):
        evaluated = bundles(emitter, count, 16, 3)
        samples[f"evaluation of {count}"] = [
            array for _, share, part in evaluated for array in [*arrays(part), np.array(share)]
        ]
    samples["verification"] = arrays(independent_rays(small_spec(), emitter, 1000, 9))
    return samples


@pytest.mark.parametrize("name", first_by_day(4, NAMES))
def test_the_light_of_a_file_left_on_disk_is_that_of_the_loaded_one(name, tmp_path, unread):
    spec = sources(tmp_path)[name]
    material = None if name in ("plain", "placed", "arrays", "two files") else MATERIALS["PMMA"]
    loaded = load_ray_set(spec, material)
    expected, spectrum = light(loaded, spec), spectrum_of_source(spec, loaded.summary)
    unread()
    left = load_ray_set(spec, material)
    assert isinstance(loaded.rays, RayBundle) and not isinstance(left.rays, RayBundle)
    np.testing.assert_allclose(left.outline(), loaded.outline(), rtol=1e-9, atol=1e-12)
    samples, again = light(left, spec), spectrum_of_source(spec, left.summary)
    assert samples.keys() == expected.keys()
    for part, known in expected.items():
        assert len(samples[part]) == len(known)
        for sample, other in zip(samples[part], known, strict=True):
            # watts of lumens by a mean over blocks: the same to rounding
            np.testing.assert_allclose(sample, other, rtol=1e-14 if name == "lumens" else 0.0, err_msg=part)
    assert (spectrum is None) == (again is None)
    if spectrum is not None:
        np.testing.assert_allclose(again.power_density, spectrum.power_density, rtol=1e-12)
    assert alike(left.summary.model_dump(), loaded.summary.model_dump())


def alike(one, other):
    """The same words and counts, and numbers but for rounding."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(alike, one, other))
    return one == pytest.approx(other, rel=1e-11, abs=1e-14) if isinstance(one, float) else one == other


@pytest.mark.nightly("large files, in processes")
def test_the_memory_of_a_source_does_not_grow_with_its_file(tmp_path):
    """2.2 million rays would be 123 MB loaded, and half as much again for each change of them; numbers are 18 MB."""
    count = 2_200_000
    path = saved(tmp_path / "led.tm25ray", led(count))
    tracemalloc.start()
    try:
        emitter = load_ray_set(RayfileSource(file=path, **PLACED))
        _, loading = tracemalloc.get_traced_memory()
        emitter.outline()
        steps, held = divided(emitter, 0.8, 7)
        smoothed(steps).sample(2**13, 1)
        for _ in bundles(emitter, 2**20, 16, 3):
            pass
        independent_rays(small_spec(), emitter, 2**14, 9)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert isinstance(emitter, RaySetEmitter) and len(emitter) == count and len(steps) + len(held) == count
    assert loading < 70e6
    assert peak < 110e6
