"""The referee's rays through further bodies, against spheres written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from chains import clear, upwards
from shells import DOME, SECOND, by_hand, placed, spheres_of

from lensforge.optics.media import Medium
from lensforge.proof.body_cast import behind_optics
from lensforge.surfaces.asphere import sphere


def test_displaced_shells_refract_polarise_and_absorb_as_written_by_hand() -> None:
    media, rays = replace(clear(), bodies=(DOME, SECOND)), upwards(1500, 1, 3.0)
    points, along, share = behind_optics(rays.origins, rays.directions, media, np.full(len(rays), 550.0))
    out = share > 0.0
    assert 0.5 < out.mean() < 1.0 and np.isnan(points[~out]).all()
    wanted = by_hand(rays.origins, rays.directions, [*spheres_of(DOME), *spheres_of(SECOND)])
    for found, exact, error in zip((points, along, share), wanted, (1e-10, 1e-12, 1e-12), strict=True):
        assert np.abs(found - exact)[out].max() < error


def test_light_past_the_rim_or_reflected_totally_is_lost() -> None:
    """A small lens in a ball far off its cavity: oblique light does not leave; nor does what goes down past the rim."""
    hollow = placed("hollow", (sphere(12.0, -11.0), sphere(5.5)), turn=np.eye(3), medium=Medium(3.0))
    rays = upwards(600, 2)
    directions = rays.directions * np.where(np.arange(600) % 3 == 0, -1.0, 1.0)[:, None]
    _, _, share = behind_optics(rays.origins, directions, replace(clear(), bodies=(hollow,)), np.full(600, 550.0))
    assert (share[::3] == 0.0).all()
    assert (share > 0.0).any() and (np.delete(share, np.s_[::3]) == 0.0).any()


@pytest.mark.parametrize("index", [1.0, 1.33])
def test_a_body_of_the_index_around_it_changes_no_line(index: float) -> None:
    media = replace(clear(), outside_index=index, bodies=(replace(DOME, medium=Medium(index)),))
    rays = upwards(400, 3, 2.0)
    points, along, share = behind_optics(rays.origins, rays.directions, media, np.full(400, 550.0))
    out = share > 0.0
    assert share[out] == pytest.approx(1.0, abs=1e-14) and np.abs(along - rays.directions)[out].max() < 1e-14
    assert np.abs(np.cross(points - rays.origins, rays.directions))[out].max() < 1e-12
