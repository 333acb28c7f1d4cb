"""Faces, lens and source out of place, shrinkage and roughness: against closed forms, the tracer in torch, differences.

No oracle here but the last uses the frames of the kernels: whole scenes are moved by hand.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from exact_surface import ExactSurface
from landed import trace_exact, trace_tables
from scenes import random_surface, sphere, table_of

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.optics.pose import Pose
from lensforge.scene.made_part import AsMade
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

N = 1.4936
Z = 1000.0
GRID = TableGrid(121)
BUMPY = random_surface(1, 0.8, 0.01), random_surface(2, 2.45, 0.008)
TABLES = [table_of(surface, GRID) for surface in BUMPY]
RAYS = SquareEmitter(1.1).sample(512, 0)  # its corners lie near the rim of the cavity
ODD = AsMade(
    source=Pose.displaced((0.01, -0.02, 0.015), (0.02, -0.01, 0.0)),
    source_centre_mm=(0.05, 0.0, 0.0),
    lens=Pose.displaced((-0.02, 0.01, -0.03), (-0.015, 0.02, 0.0)),
    faces={"outer": Pose.displaced((0.03, 0.02, -0.02), (0.01, 0.03, 0.0))},
    source_size=1.05,
    scale=0.98,
    seat_mm=1.5,
    slopes={"inner": 2e-3, "outer": 1e-3},
)


def _scene(made: AsMade | None, media: Media | None = None) -> Scene:
    return Scene(media or Media(Medium(N)), GRID, made=made)


def _exact() -> list[ExactSurface]:
    return [ExactSurface.of(s, requires_grad=True) for s in BUMPY]


def test_a_lens_as_designed_has_the_same_bits() -> None:
    plain, same = (trace_tables(TABLES, _scene(made), RAYS) for made in (None, AsMade()))
    for name in ("points", "directions", "flux", "sin2_exit", "fates"):
        assert torch.equal(getattr(plain, name), getattr(same, name))


@pytest.mark.parametrize("absorption", [0.0, 0.05])
def test_the_tracer_in_torch_agrees(absorption: float) -> None:
    media = Media(Medium(N, absorption))
    exact = trace_exact(*_exact(), media, RAYS, ODD)
    exits = trace_tables(TABLES, _scene(ODD, media), RAYS)
    assert torch.equal(exits.fates, exact.fates)
    for name, most in (("points", 3e-5), ("directions", 1e-4), ("flux", 1e-5)):
        assert (getattr(exits, name) - getattr(exact, name)).abs().max() < most
    assert not exits.left_lens.all()


def test_a_rigid_motion_of_everything_moves_the_light_and_nothing_else() -> None:
    whole = Pose.displaced((0.3, -0.2, 0.4), (0.1, 0.05, 0.0))
    plain = trace_tables(TABLES, _scene(None), RAYS)
    moved = trace_tables(TABLES, _scene(AsMade(source=whole, lens=whole)), RAYS)
    assert torch.equal(plain.fates, moved.fates)
    assert (plain.flux - moved.flux).abs().max() < 1e-15
    out = plain.left_lens
    assert (whole.points(plain.points[out]) - moved.points[out]).abs().max() < 1e-12
    assert (whole.directions(plain.directions[out]) - moved.directions[out]).abs().max() < 1e-12


def test_a_source_moved_one_way_is_a_lens_moved_the_other() -> None:
    by = (0.04, -0.03, 0.02)
    source = trace_tables(TABLES, _scene(AsMade(source=Pose.displaced(by))), RAYS)
    lens = trace_tables(TABLES, _scene(AsMade(lens=Pose.displaced(tuple(-x for x in by)))), RAYS)
    by_hand = trace_tables(TABLES, _scene(None), replace(RAYS, origins=RAYS.origins + np.array(by)))
    out = source.left_lens
    assert torch.equal(source.fates, by_hand.fates)
    assert torch.equal(source.fates, lens.fates)
    assert (source.points - by_hand.points).abs().max() < 1e-13
    assert (source.points[out] - torch.tensor(by, dtype=torch.float64) - lens.points[out]).abs().max() < 1e-13


def test_a_smaller_lens_on_a_smaller_source_is_the_same_lens_but_for_scale() -> None:
    scale = 0.9
    plain = trace_tables(TABLES, _scene(None), RAYS)
    small = trace_tables(TABLES, _scene(AsMade(source_size=scale, scale=scale)), RAYS)
    assert torch.equal(plain.fates, small.fates)
    assert (scale * plain.points - small.points).abs().max() < 1e-13


def test_a_lens_that_shrinks_keeps_its_seat() -> None:
    seat = 2.0
    scale = 0.95
    raised = seat * (scale - 1.0)
    shrunk = trace_tables(TABLES, _scene(AsMade(scale=scale, seat_mm=seat)), RAYS)
    up = np.array([0.0, 0.0, raised])
    by_hand = trace_tables(
        [table_of(s, GRID) * scale for s in BUMPY], _scene(None), replace(RAYS, origins=RAYS.origins - up)
    )
    out = by_hand.left_lens
    assert torch.equal(shrunk.fates, by_hand.fates)
    assert (shrunk.points - by_hand.points - torch.from_numpy(up))[out].abs().max() < 1e-12


def test_faces_of_a_body_of_four_are_met_each_in_its_own_frame() -> None:
    """A point goes through the frames as by hand: into the lens, from face to face by where they lie, and out."""
    names = ("cap", "side", "wall", "exit")
    moves = [ODD.source, ODD.lens, ODD.faces["outer"]]
    made = replace(ODD, names=names, faces=dict(zip(names[1:], moves, strict=True)), slopes={"wall": 1e-3})
    frames, into, out = made.placed.packed()
    assert frames.shape == (5, 3, 4)
    centre = np.array(made.source_centre_mm)
    world = centre + made.source.points(1.05 * ([0.1, 0.2, 0.3] - centre))
    raised = made.lens.to_local_points(world)
    in_body = (raised - [0.0, 0.0, 1.5 * (0.98 - 1.0)]) / 0.98
    point = into * frames[0, :, :3] @ [0.1, 0.2, 0.3] + frames[0, :, 3]
    assert np.allclose(point, in_body, atol=1e-15)
    for frame, name in zip(frames[1:], names[1:], strict=False):
        point = frame[:, :3] @ point + frame[:, 3]
        face = made.faces[name]
        assert np.allclose(face.points(point), in_body, atol=1e-15)
    assert np.allclose(out * frames[4, :, :3] @ point + frames[4, :, 3], world, atol=1e-15)
    assert made.rough(7).shape == (7, 8) and made.slopes_of_faces.tolist() == [0.0, 0.0, 1e-3, 0.0]
    assert replace(made, slopes={}).rough(7) is None


def test_spheres_about_another_centre_refract_as_closed_forms_say() -> None:
    """A ray from the centre of a moved outer sphere goes straight through it; the inner sphere is met at its own."""
    shift = np.array([0.1, 0.05, 0.2])
    along = np.array([[0.2, 0.3, 1.0], [0.0, 0.0, 1.0], [-0.5, 0.1, 0.8]])
    along /= np.linalg.norm(along, axis=1)[:, None]
    rays = RayBundle(np.repeat(shift[None], 3, axis=0), along, np.ones(3))
    spheres = [table_of(sphere(r), GRID) for r in (1.0, 3.0)]
    everything = AsMade(source=Pose(), lens=Pose.displaced(tuple(shift)))
    exits = trace_tables(spheres, _scene(everything), rays)
    assert np.allclose(exits.points.numpy(), shift + 3.0 * along, atol=1e-9)
    only_outer = AsMade(faces={"outer": Pose.displaced(tuple(shift))})
    exits = trace_tables(spheres, Scene(Media(Medium(1.0)), GRID, made=only_outer), rays)
    assert np.allclose(exits.points.numpy(), shift + 3.0 * along, atol=1e-9)


def test_rays_below_the_plane_of_a_raised_outer_face_enter_it_through_that_plane_or_the_base() -> None:
    raised = AsMade(faces={"outer": Pose.displaced((0.0, 0.0, 0.3))})
    media = Media(Medium(1.0))
    along = np.array([[1.0, 0.0, 0.05], [1.0, 0.0, 0.3], [1.0, 0.0, 0.2]])
    along /= np.linalg.norm(along, axis=1)[:, None]
    rays = RayBundle(np.zeros((3, 3)), along, np.ones(3))
    balls = [sphere(r) for r in (1.0, 2.0)]
    in_torch = trace_exact(*map(ExactSurface.of, balls), media, rays, raised)
    in_kernels = trace_tables([table_of(ball, GRID) for ball in balls], _scene(raised, media), rays)
    for exits in (in_kernels, in_torch):
        assert exits.fates.tolist() == [Fate.BASE, Fate.LEFT_LENS, Fate.LEFT_LENS]
        out = exits.points.numpy()[1:] - [0.0, 0.0, 0.3]
        assert np.allclose(np.linalg.norm(out, axis=1), 2.0)


def test_roughness_is_a_convolution_and_loses_no_light() -> None:
    """A face of small rms slope s spreads rays at normal incidence by s (n - 1) along any line."""
    slope = 1e-3
    count = 100_000
    up = np.repeat(np.array([[0.0, 0.0, 1.0]]), count, axis=0)
    rays = RayBundle(np.zeros((count, 3)), up, np.full(count, 1.0 / count))
    spheres = [table_of(sphere(r), GRID) for r in (1.0, 3.0)]
    for made, spread in (
        (AsMade(slopes={"outer": slope}), slope * (N - 1.0)),
        # the inner face turns the ray by slope (1 - 1/n), at 2 mm from the outer one, which turns it n-fold and back
        (AsMade(slopes={"inner": slope}), slope * (1.0 - 1.0 / N) * (N - (N - 1.0) * 2.0 / 3.0)),
    ):
        exits = trace_tables(spheres, Scene(Media(Medium(N)), GRID, fresnel=False, made=made), rays)
        assert (exits.fates == Fate.LEFT_LENS).all()
        assert float(exits.flux.sum()) == pytest.approx(1.0, abs=1e-12)
        across = exits.directions[:, :2]
        assert across.std(dim=0).numpy() == pytest.approx([spread, spread], rel=0.01)
        assert across.mean(dim=0).abs().max() < 5.0 * spread / np.sqrt(count)
