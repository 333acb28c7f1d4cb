"""A linear lens with reflecting walls: its light by a tracer of the section, by the reference, and what it keeps."""

from collections import Counter
from dataclasses import replace
from math import inf

import numpy as np
import pytest
import torch
from chains import MixedLight
from landed import by_kernels, in_torch, on_device
from section_tracer import Section
from test_drawn_faces import led

from lensforge.kernels.fate import Fate
from lensforge.light.crease import crease_gradients
from lensforge.light.later_creases import later_crease_gradients
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.media import Media, Medium
from lensforge.optics.pose import Pose
from lensforge.scene.body import Chain
from lensforge.sources.build_source import PlacedSource
from lensforge.sources.emitting_area import Disc
from lensforge.sources.intensity import CosinePower
from lensforge.sources.planar_emitter import PlanarEmitter
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.collimator import Collimator
from lensforge.surfaces.drawn_profile import DrawnPart

INDEX = 1.49
GRID = TableGrid(401)
CHAIN = Chain(("cap", "side", "wall", "exit"), (CAVITY, CAVITY, BODY, BODY), (BODY, BODY, OUTSIDE, OUTSIDE), 6)
SCENE = Scene(Media(Medium(INDEX)), GRID, chain=CHAIN, drawn_half_mm=inf)
COUNT = 32


def crooked() -> dict[str, DrawnPart]:
    """Faces of a collimator, none of them symmetric: the left wall, side and cap are others than the right ones."""
    right = Collimator(INDEX, 9.0, 2.0, 2.6)
    left = Collimator(INDEX, 10.0, 2.2, 2.6)
    reach = 1.4 * float(np.hypot(left.radius_mm, left.height_mm))
    angles = np.linspace(0.0, 0.5 * np.pi + 0.06, 300)
    ways = np.column_stack([np.sin(angles), np.cos(angles)])
    wall = [half.wall(angles[angles > half.crease_rad - 0.06]) for half in (right, left)]
    flip = np.array([-1.0, 1.0])

    def both(points: tuple[np.ndarray, np.ndarray], reach_mm: float) -> DrawnPart:
        kept = [half[np.hypot(*half.T) < reach_mm] for half in points]
        return DrawnPart.through(np.concatenate([kept[0], kept[1] * flip]), reach_mm, COUNT)

    steep = angles > 0.2
    side = tuple(
        ways[steep] * half.cavity_mm / (ways[steep, :1] + np.tan(half.draft_rad) * ways[steep, 1:])
        for half in (right, left)
    )
    low = angles < 1.2
    cap = tuple(height * ways[low] * (INDEX - 1.0) / (INDEX * ways[low, 1:] - 1.0 + 0.3) for height in (3.1, 3.1))
    slant = tuple(ways[low] * 6.9 / (ways[low, 1:] + tilt * ways[low, :1]) for tilt in (0.05, -0.05))
    return {"cap": both(cap, 6.0), "side": both(side, 6.0), "wall": both((wall[0], wall[1]), reach),
            "exit": both(slant, reach)}  # fmt: skip


FACES = crooked()


def tables_of(faces: dict[str, DrawnPart]) -> np.ndarray:
    return np.stack([tabulate(GRID, face) for face in faces.values()])


@pytest.mark.parametrize("half_mm", [inf, 35.0])
def test_the_reference_tracer_agrees(half_mm: float) -> None:
    scene = replace(SCENE, drawn_half_mm=half_mm)
    tables = [torch.from_numpy(table) for table in tables_of(FACES)]
    rays = led(1500, 7)
    kernels = by_kernels(tables, scene, rays, 100.0)
    reference = in_torch(on_device(tables, scene, rays, "cpu"), 100.0)
    assert torch.equal(reference.fates, kernels.fates)
    assert torch.allclose(reference.carried, kernels.carried, rtol=1e-10, atol=0.0)
    assert torch.allclose(reference.hits, kernels.hits, rtol=1e-7, atol=1e-7)
    assert half_mm == inf or bool((kernels.fates == int(Fate.FLANGE)).any())


def test_light_is_that_of_polygons_in_the_plane() -> None:
    """The faces that each ray meets, where it leaves, and its direction; of some rays the sides of polygons err."""
    rays = led(250, 3)
    traced = TracedBundle.of(tables_of(FACES), SCENE, rays)
    section = Section({name: face.coefficients for name, face in FACES.items()}, INDEX)
    ways = Counter[tuple[str, ...]]()
    differing = 0
    for k in range(len(rays)):
        ended = section.trace(rays.origins[k], rays.directions[k], CHAIN.events)
        met = tuple(CHAIN.names[code >> 2] for code in traced.met[k] if code >= 0)
        left = traced.exits.fates[k] == Fate.LEFT_LENS
        if (met, left) != (ended.met, ended.point is not None):
            differing += 1
            continue
        ways[met] += 1
        if left:
            assert traced.exits.directions[k] == pytest.approx(ended.direction, abs=1e-3)
            assert traced.exits.points[k] == pytest.approx(ended.point, abs=2e-3)
            assert traced.exits.directions[k, 1] == pytest.approx(rays.directions[k, 1], abs=1e-13), "kept along y"
    assert differing <= 3 and ways["side", "wall", "exit"] > 40 and ways["cap", "exit"] > 40


def test_every_ray_ends_and_no_light_is_won() -> None:
    rays = led(20_000, 9, spread=3.0)
    for half_mm in (inf, 40.0):
        exits = TracedBundle.of(tables_of(FACES), replace(SCENE, drawn_half_mm=half_mm), rays).exits
        assert not np.isin(exits.fates, [Fate.NOT_CONVERGED, Fate.SURFACES_INTERSECT]).any()
        assert (exits.flux <= rays.flux).all() and exits.flux[exits.left_lens].sum() > 0.4 * rays.flux.sum()


def scaled(name: str, factor: float) -> np.ndarray:
    """Tables with one face larger by a factor."""
    face = FACES[name]
    return tables_of(FACES | {name: replace(face, coefficients=tuple(np.divide(face.coefficients, factor)))})


def test_gradients_by_the_tables_are_those_of_differences() -> None:
    mixed = MixedLight(tables_of(FACES), replace(SCENE, drawn_half_mm=45.0), led(400, 5), 3)
    for name in FACES:
        slope = mixed.slope((scaled(name, 1.0 + 1e-3) - scaled(name, 1.0 - 1e-3)) / 2e-3, 1e-6)
        assert slope.crossed < 20 and abs(slope.adjoint - slope.differences) < slope.error + 1e-5 * abs(slope.adjoint)


def mixed_light(traced: TracedBundle) -> np.ndarray:
    """What each ray is worth, by where and how it leaves."""
    x, _, z = traced.exits.directions.T
    return traced.exits.flux * traced.exits.left_lens * (x + z**2 + 0.05 * traced.exits.points[:, 0])


LED = PlacedSource(PlanarEmitter(Disc(1.0), CosinePower(1.5)), Pose.of_tilts((0.3, 2.0, 0.05), (6.0, 0.0)))


@pytest.mark.parametrize("name", ["cap", "side"])
def test_light_that_changes_its_first_face_is_in_the_slope(name: str) -> None:
    """By the light of those rays alone; the error is that of counting them."""
    rays = LED.sample(2**17, 5)
    ends = [scaled(name, 1.0 + sign * 0.01) for sign in (1.0, -1.0)]
    once = replace(SCENE, chain=replace(CHAIN, events=1))
    first, other = (TracedBundle.of(tables, once, rays).met[:, 0] for tables in ends)
    crossing = rays.take(first != other)
    more, less = (mixed_light(TracedBundle.of(tables, SCENE, crossing)) for tables in ends)
    gradients = crease_gradients(tables_of(FACES), SCENE, LED, mixed_light, 2**12, 3)
    change = (more - less) / 0.02
    error = float(np.sqrt((change**2).sum()))
    assert len(crossing) > 400
    assert abs((gradients * (ends[0] - ends[1]) / 0.02).sum() - change.sum()) < 3.0 * error < abs(change.sum())


def test_light_that_changes_a_later_face_is_in_the_slope() -> None:
    """Between wall and exit, as the wall moves."""
    rays = LED.sample(2**18, 7)
    ends = [scaled("wall", 1.0 + sign * 0.01) for sign in (1.0, -1.0)]
    twice = replace(SCENE, chain=replace(CHAIN, events=2))
    met, other = (TracedBundle.of(tables, twice, rays).met[:, 1] >> 2 for tables in ends)
    crossing = rays.take((met != other) & (met >= 2) & (other >= 2))
    more, less = (mixed_light(TracedBundle.of(tables, SCENE, crossing)) for tables in ends)
    gradients = later_crease_gradients(tables_of(FACES), SCENE, LED, mixed_light, 2**9, 64, 1)
    change = (more - less) / 0.02
    error = float(np.sqrt((change**2).sum()))
    assert len(crossing) > 100
    assert abs((gradients * (ends[0] - ends[1]) / 0.02).sum() - change.sum()) < 3.0 * error < abs(change.sum())
