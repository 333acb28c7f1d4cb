"""Place of a source in the lens: closed forms of its rays, the symmetry that is left, and where its light goes."""

import numpy as np
import pytest
import torch
from landed import by_kernels
from scenes import small_spec, sphere, table_of

import lensforge as lf
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media
from lensforge.sources.build_source import build_source, summarise
from lensforge.sources.source_pose import PlacedSource
from lensforge.surfaces.bicubic_table import TableGrid

GRID = TableGrid(65)
SPHERES = tuple(table_of(sphere(radius), GRID) for radius in (3.0, 6.0))
SCENE = Scene(Media(1.5), GRID)
BEAM = lf.CosineIntensity(power=1e4)


def _traced(spec: lf.SquareSource | lf.DiscSource, count: int = 2**14):
    """Through a lens of two spheres about the origin, onto a plane at 100 mm."""
    return by_kernels([*SPHERES], SCENE, build_source(spec).sample(count, 3), 100.0)


SQUARE, OBLONG = {"kind": "square", "side_mm": 1.0}, {"kind": "rectangle", "width_mm": 2.0, "height_mm": 1.0}


@pytest.mark.parametrize(
    ("source", "symmetry"),
    [
        (SQUARE | {"position_mm": [0, 0, -0.5]}, "square"),
        (SQUARE | {"position_mm": [0.5, 0, 0]}, "mirror_y"),
        (SQUARE | {"position_mm": [0, 0.5, 1]}, "mirror_x"),
        (SQUARE | {"position_mm": [0.5, 0.5, 0]}, "none"),
        (SQUARE | {"tilt_deg": [0, 10]}, "mirror_y"),
        (SQUARE | {"tilt_deg": [10, 0]}, "mirror_x"),
        (SQUARE | {"tilt_deg": [10, 10]}, "none"),
        (SQUARE | {"tilt_deg": [0, 10], "position_mm": [0.5, 0, 0]}, "mirror_y"),
        (SQUARE | {"tilt_deg": [10, 0], "position_mm": [0.5, 0, 0]}, "none"),
        (SQUARE | {"rotate_z_deg": 45}, "square"),
        (SQUARE | {"rotate_z_deg": 45 + 1e-9}, "none"),  # more than rounding
        (SQUARE | {"rotate_z_deg": 180}, "square"),
        (SQUARE | {"rotate_z_deg": 30}, "none"),
        (SQUARE | {"rotate_z_deg": 45, "tilt_deg": [0, 10]}, "mirror_y"),
        (OBLONG | {"rotate_z_deg": 90}, "rectangle"),
        (OBLONG | {"rotate_z_deg": 45}, "none"),
        (OBLONG | {"rotate_z_deg": 90, "tilt_deg": [10, 0]}, "mirror_x"),
    ],
)
def test_the_symmetry_that_its_place_leaves(source, symmetry):
    spec = small_spec(source=source).source
    placed = build_source(spec)
    assert isinstance(placed, PlacedSource) and placed.symmetry == symmetry
    assert summarise(placed, spec).symmetry == symmetry


def test_through_concentric_spheres_a_tilted_beam_lands_where_it_points():
    """Rays from the common centre are not refracted: a beam tilted about y lands at x = 100 mm tan 15 deg."""
    landed = _traced(lf.DiscSource(diameter_mm=1e-6, intensity=BEAM, tilt_deg=(0.0, 15.0)))
    assert bool(landed.landed.all())
    np.testing.assert_allclose(landed.hits.median(dim=0).values, [100.0 * np.tan(np.deg2rad(15.0)), 0.0], atol=0.05)


def test_light_of_a_die_in_its_cup_enters_where_it_passes_the_plane_of_the_base():
    """Lambertian point 1 mm below z = 0, an opening of 3 mm: sin^2 = 9 / (9 + 1) of the light enters."""
    landed = _traced(lf.SquareSource(side_mm=0.0, position_mm=(0.0, 0.0, -1.0)), 2**16)
    outside = float((landed.fates == Fate.OUTSIDE_CAVITY).double().mean())
    assert outside == pytest.approx(0.1, abs=1e-4)
    assert float((landed.fates == Fate.BACKWARD).double().mean()) == 0.0


def test_of_a_tilted_die_the_rays_below_the_horizon_are_counted():
    """Lambertian point, tilted by 30 deg: (1 - cos 30) / 2 of its light goes below the horizon, all of it lost."""
    below = 0.5 * (1.0 - np.cos(np.deg2rad(30.0)))
    landed = _traced(lf.SquareSource(side_mm=0.0, tilt_deg=(30.0, 0.0)), 2**16)
    assert float((landed.fates == Fate.BACKWARD).double().mean()) == pytest.approx(below, abs=1e-4)
    assert float(torch.as_tensor(landed.carried).sum()) > 0.9


def test_the_title_says_where_the_source_sits():
    spec = lf.SquareSource(side_mm=1.0, position_mm=(1.0, 0.0, -0.5), tilt_deg=(0.0, 10.0))
    assert spec.title == "1 mm square Lambertian source at (1, 0, -0.5) mm tilted by (0, 10)°"
    assert lf.DiscSource(diameter_mm=1.0).title == "1 mm disc source"


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ({"position_mm": [0, 0]}, r"source\.position_mm"),
        ({"position_mm": [0, 0, 1e10]}, r"source\.position_mm\.2"),
        ({"tilt_deg": [0, 400]}, r"source\.tilt_deg\.1 = 400"),
        ({"tilt_deg": 10}, r"source\.tilt_deg"),
    ],
)
def test_a_wrong_place_is_named_as_the_user_wrote_it(place, message):
    with pytest.raises(lf.InputError, match=message):
        small_spec(source=SQUARE | place)
