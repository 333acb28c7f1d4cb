"""Studies of a lens with measured rays: they trace no more rays than the file has, and say so."""

import numpy as np
import pytest
from measured_lenses import directions, lens
from nightly import first_by_day
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


@pytest.mark.parametrize(
    ("rays", "traced"), first_by_day(1, [(64, 64), (4096, 90)], "three studies; by day they state fewer rays")
)
def test_a_study_states_the_rays_that_no_search_has_used(made, rays, traced):
    for study in studies(made, rays=rays):
        assert study.rays == traced, study.stage
        assert (study.conditions is None) if rays > traced else (study.conditions.rays == traced)
