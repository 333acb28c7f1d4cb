"""Studies of a lens with measured rays: they trace no more rays than the file has, and say so."""

import numpy as np
import pytest
from measured_lenses import directions, lens
from second_cuts import measured

import lensforge as lf
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile

MEASURED = 300


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A lens whose source is a file of few rays, and points measured on its inner surface."""
    folder = tmp_path_factory.mktemp("measured")
    led = RayFile(
        positions_mm=np.zeros((MEASURED, 3), dtype=np.float32),
        directions=directions(MEASURED, 2).astype(np.float32),
        flux=np.ones(MEASURED, dtype=np.float32),
        flux_unit="W",
        wavelengths_nm=None,
        header_flux_w=float(MEASURED),
        header_flux_lm=None,
    )
    write_rayfile(folder / "led.tm25ray", led, "tm25")
    design = lens({"kind": "rayfile", "file": str(folder / "led.tm25ray")}, rays=4096)
    np.savetxt(folder / "points.csv", measured(design.inner, lambda u: 1e-3 * u[:, 2], 1200), delimiter=",")
    return design, folder / "points.csv"


def studies(made, **rays):
    design, points = made
    yield lf.compare(design, points=points, surface="inner", **rays)
    yield lf.correct(design, points=points, surface="inner", wavelength_mm=2.5, **rays)
    yield lf.sensitivity(design, **rays)


@pytest.mark.nightly("three studies; by day they state fewer rays")
def test_a_study_states_the_rays_of_the_file(made):
    for found in studies(made, rays=4096):
        assert found.rays == 0.3 * MEASURED and found.conditions is None, "those that no search has used"


def test_fewer_rays_than_the_file_has_are_other_conditions(made):
    for found in studies(made, rays=64):
        assert found.rays == found.conditions.rays == 64, found.stage
