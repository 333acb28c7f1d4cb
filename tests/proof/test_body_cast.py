"""The referee's rays through further bodies, against spheres written by hand."""

from dataclasses import replace

import numpy as np
import pytest
from chains import clear, upwards
from shells import DOME, SECOND, by_hand, placed, spheres_of

from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.media import CoverGlass, FaceScatter, Medium
from lensforge.optics.pose import Pose
from lensforge.optics.scattering import GaussianFacets, RingScatter
from lensforge.proof.body_cast import behind_optics
from lensforge.proof.facet_tilt import FaceNumbers, _mixed
from lensforge.proof.optical_faces import PlateOfLenses
from lensforge.scene.made_part import AsMade
from lensforge.scene.rough_faces import with_facets
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate


def test_keys_are_mixed_as_published() -> None:
    """The first numbers of SplitMix64 from 0 (Steele, Lea and Flood, 2014), as Java's SplittableRandom has them."""
    keys = np.uint64(0x9E3779B97F4A7C15) * np.arange(1, 4, dtype=np.uint64)
    assert _mixed(keys).tolist() == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]


def test_displaced_shells_refract_polarise_and_absorb_as_written_by_hand() -> None:
    media = replace(clear(), bodies=(DOME, SECOND))
    rays = upwards(1500, 1, 3.0)
    points, along, share, _ = behind_optics(rays.origins, rays.directions, media, np.full(len(rays), 550.0))
    out = share > 0.0
    assert 0.5 < out.mean() < 1.0 and np.isnan(points[~out]).all()
    wanted = by_hand(rays.origins, rays.directions, [*spheres_of(DOME), *spheres_of(SECOND)])
    for values, exact, error in zip((points, along, share), wanted, (1e-10, 1e-12, 1e-12), strict=True):
        assert np.abs(values - exact)[out].max() < error


def test_light_past_the_rim_or_reflected_totally_is_lost() -> None:
    """A small lens in a ball far off its cavity: oblique light does not leave; nor does what goes down past the rim."""
    hollow = placed("hollow", (sphere(12.0, -11.0), sphere(5.5)), turn=Pose(), medium=Medium(3.0))
    rays = upwards(600, 2)
    directions = rays.directions * np.where(np.arange(600) % 3 == 0, -1.0, 1.0)[:, None]
    _, _, share, _ = behind_optics(rays.origins, directions, replace(clear(), bodies=(hollow,)), np.full(600, 550.0))
    assert (share[::3] == 0.0).all()
    assert (share > 0.0).any() and (np.delete(share, np.s_[::3]) == 0.0).any()


@pytest.mark.parametrize("index", [1.0, 1.33])
def test_a_body_of_the_index_around_it_changes_no_line(index: float) -> None:
    media = replace(clear(), outside_index=index, bodies=(replace(DOME, medium=Medium(index)),))
    rays = upwards(400, 3, 2.0)
    points, along, share, _ = behind_optics(rays.origins, rays.directions, media, np.full(400, 550.0))
    out = share > 0.0
    assert share[out] == pytest.approx(1.0, abs=1e-14) and np.abs(along - rays.directions)[out].max() < 1e-14
    assert np.abs(np.cross(points - rays.origins, rays.directions))[out].max() < 1e-12


GLASS = CoverGlass(1.52, 3.0, 40.0, 2e-3)


STEEP = RingScatter((0.0, 0.05, 0.2, 0.5), ((0.0, 0.1, 0.3, 0.6), (0.0, 0.3, 0.4, 0.5)), (0.3, 1.0))


@pytest.mark.parametrize("scatters", [False, True])
def test_kernels_and_cast_agree_on_the_light_behind_bodies_and_the_cover_glass(scatters: bool) -> None:
    """Light that a lens of displaced, rough faces, out of place, has polarised; through faces that scatter it, too."""
    grid = TableGrid(161)
    tables = np.stack([tabulate(grid, surface) for surface in (sphere(3.0, 0.5), sphere(6.0, -1.0))])
    media = replace(clear(absorption=0.01), bodies=(DOME, SECOND), cover_glass=GLASS)
    rays = upwards(2000, 4, 0.8)
    rough: list[FaceNumbers] = []
    if scatters:
        by_body = (
            (FaceScatter("outer", STEEP),),
            (FaceScatter("inner", GaussianFacets(0.05)), FaceScatter("outer", STEEP)),
        )
        bodies = (replace(body, scatter=facets) for body, facets in zip((DOME, SECOND), by_body, strict=True))
        media = replace(media, bodies=tuple(bodies))
        rays = with_facets(rays, 3)
        met = [(rays, body.media(media), DOUBLE, media.scattering_before(k)) for k, body in enumerate(media.bodies)]
        rough = [FaceNumbers.of(*arguments) for arguments in met]
    made = AsMade(lens=Pose.displaced((0.1, -0.2, 0.0), (0.02, -0.03, 0.0)), slopes={"inner": 2e-3}, scale=1.01)
    traced = TracedBundle.of(tables, Scene(media, grid, made=made), rays)
    lens = traced.at_lens
    exits = traced.exits
    fields = lens.fields.reshape(-1, 2, 2, 3)[:, :, 0]
    fields = fields / np.sqrt(0.5 * (fields**2).sum((1, 2)) + 1e-300)[:, None, None]
    behind = behind_optics(lens.points, lens.directions, media, np.full(2000, 550.0), fields + 0j, rough=rough)
    out = exits.left_lens
    assert 0.4 < out.mean() < 0.95 and (np.isfinite(behind.points[:, 0]) == out)[lens.left_lens].all()
    wanted = lens.flux[out] * behind.through_bodies[out] * behind.through_glass[out]
    turned = np.linalg.norm(exits.directions - behind.directions, axis=1)[out]
    of_grazing = 2.0 * turned / np.abs(behind.directions[out, 2])  # each face of the glass passes as the cosine there
    assert (np.abs(exits.flux[out] / wanted - 1.0) < 1e-6 + of_grazing).all()
    assert exits.lost_in_glass[out] == pytest.approx(wanted * (1.0 / behind.through_glass[out] - 1.0), rel=3e-5)
    assert np.abs(exits.directions - behind.directions)[out].max() < 1e-6
    apart = np.cross(exits.points - behind.points, exits.directions)
    assert np.abs(apart)[out].max() < 1e-3, "on the same lines"


def test_each_lens_of_a_plate_has_bodies_of_its_own() -> None:
    """Rays of lenses that are turned and shifted, as those of the first turned and shifted behind its bodies.

    Polarised along one line each, which the bodies and the glass before them all tell.
    """
    media = replace(clear(), bodies=(DOME, SECOND), cover_glass=GLASS)
    rays = upwards(900, 6, 2.0)
    across = np.cross(rays.directions, np.random.default_rng(9).normal(size=(900, 3)))
    across *= np.sqrt(2.0) / np.linalg.norm(across, axis=1)[:, None]

    def fields(lines: np.ndarray) -> np.ndarray:
        return np.stack([lines, np.zeros_like(lines)], axis=1) + 0j

    numbers = np.arange(900) % 3
    waves = np.full(900, 550.0)
    places = np.array([[0.0, 0.0], [80.0, 10.0], [-20.0, 90.0]])
    turns = np.array([0.3, 1.9, -2.5])
    alone = behind_optics(rays.origins, rays.directions, media, waves, fields(across))
    for lit in (None, 1):
        plate = PlateOfLenses(places, turns, lit)
        there = plate.placed(rays, numbers)
        wanted = plate.placed(RayBundle(alone.points, alone.directions, rays.flux), numbers)
        seen = Pose.of_tilts(turn_deg=0.0 if lit is None else np.degrees(turns[lit])).rotation
        lines = plate.placed(RayBundle(rays.origins, across, rays.flux), numbers).directions @ seen
        starts = plate.from_lit(there.origins)
        exits = behind_optics(starts, there.directions @ seen, media, waves, fields(lines), plate=plate)
        out = alone.through_bodies > 0.0
        assert exits.through_bodies == pytest.approx(alone.through_bodies, abs=1e-12)
        assert exits.through_glass[out] == pytest.approx(alone.through_glass[out], abs=1e-12)
        assert np.abs(exits.points - plate.from_lit(wanted.origins))[out].max() < 1e-9
        assert np.abs(exits.directions - wanted.directions @ seen)[out].max() < 1e-12
