"""Rays of an evaluation in replicates, their flux by fate, and the error of tables: with rays whose way is known."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenes import random_surface, small_spec, sphere

from lensforge import seeds
from lensforge.kernels.fate import Fate
from lensforge.light import simulation
from lensforge.light.received_flux import flux_by_fate
from lensforge.light.simulation import TracedLens, bundles, simulate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver_shapes import Plane
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, table_error

PLANE = Plane(Pose.facing((0.0, 0.0, 1.0), (0.0, 0.0, 10.0)), PixelGrid(6.0, 4.0, 3, 2), Window(4.0, 3.0))


def upwards(count: int, flux: Sequence[float] | None = None) -> RayBundle:
    """Rays along the axis, each numbered by its x."""
    origins = np.zeros((count, 3))
    origins[:, 0] = np.arange(count)
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    return RayBundle(origins, up, np.ones(count) if flux is None else np.array(flux))


@dataclass
class Given:
    """A source that notes what it is asked for; ``rays`` of a measured one."""

    rays: RayBundle | None = None
    flux_w: float = 3.0
    symmetry: str = "none"

    def __post_init__(self) -> None:
        self.asked: list[tuple[int, int]] = []

    @property
    def ray_count(self) -> int | None:
        return None if self.rays is None else len(self.rays)

    def sample(self, count: int, seed: int) -> RayBundle:
        self.asked.append((count, seed))
        if self.rays is not None:
            return self.rays.take(slice(0, count))
        return upwards(1, [self.flux_w])

    def outline(self) -> np.ndarray:
        return np.zeros((3, 3))


class Straight(TracedLens):
    """A lens that rays pass straight up from where they start; ``exits`` instead, where some are given."""

    exits: ExitRays | None = None

    def trace(self, rays: RayBundle) -> ExitRays:
        if self.exits is not None:
            return self.exits
        count = len(rays)
        arrays = rays.origins, rays.directions, rays.flux, np.zeros(count), np.zeros(count, dtype=np.int8)
        return ExitRays(*(np.ascontiguousarray(array) for array in arrays))


def straight(exits: ExitRays | None = None) -> Straight:
    grid = TableGrid(24)
    table = np.ones((grid.side, grid.side))
    lens = Straight(Scene(Media(Medium(1.5)), grid), np.stack((table, table)), {"inner": 2.0, "outer": 3.0})
    object.__setattr__(lens, "exits", exits)
    return lens


@pytest.mark.parametrize(
    ("rays", "replicates", "parts"), [(100, 16, 1), (2**24, 16, 1), (2**24 + 16, 16, 2), (7, 3, 1)]
)
def test_a_source_is_sampled_for_each_replicate_in_parts_of_a_million_rays(rays, replicates, parts) -> None:
    source = Given()
    rows = list(bundles(source, rays, replicates, 5))
    per_replicate = rays // replicates
    expected = [
        (-(-per_replicate // parts), seeds.of_replicate(5, replicates, replicate, parts, part))
        for replicate in range(replicates)
        for part in range(parts)
    ]
    assert source.asked == expected
    assert [(replicate, share) for replicate, share, _ in rows] == [
        (replicate, 1.0 / parts) for replicate in range(replicates) for _ in range(parts)
    ]


@pytest.mark.parametrize(("rays", "taken"), [(8, 8), (11, 11), (50, 11)])
def test_rays_of_a_file_are_divided_at_random_and_each_part_stands_for_all_light(rays: int, taken: int) -> None:
    source = Given(upwards(11, list(np.linspace(0.1, 2.0, 11))))
    rows = list(bundles(source, rays, 4, 3))
    numbers = np.concatenate([part.origins[:, 0] for _, _, part in rows])
    assert sorted(numbers) == list(range(taken)) and list(numbers) != list(range(taken))
    assert [replicate for replicate, _, _ in rows] == [0, 1, 2, 3]
    assert {len(part) for _, _, part in rows} <= {taken // 4, taken // 4 + 1}
    for _, share, part in rows:
        assert share * part.flux.sum() == pytest.approx(3.0)


@pytest.mark.parametrize(("rays", "of_file", "replicates"), [(64, None, 16), (5, None, 5), (64, 7, 7), (3, 7, 3)])
def test_there_are_up_to_sixteen_replicates_and_none_without_a_ray(rays, of_file, replicates) -> None:
    source = Given(None if of_file is None else upwards(of_file))
    traced = simulate(straight(), source, (PLANE,), rays, 1)
    (received,) = traced.received
    assert len(received.images) == len(received.window) == len(received.by_fate) == replicates
    assert traced.emitted_w == 3.0
    if of_file is None:  # one ray of 3 W in each, on the axis
        assert traced.rays == replicates
        assert (
            (received.outside == 0.0).all()
            and (received.window == 3.0).all()
            and (received.images.sum(axis=(1, 2)) == 3.0).all()
        )
    else:  # the plane holds rays up to x = 3, its window those up to 2
        assert traced.rays == min(rays, of_file)
        total = received.by_fate[:, Fate.LEFT_LENS].mean()
        assert total == pytest.approx(3.0) and received.by_fate.sum() == pytest.approx(3.0 * replicates)
        on_grid, in_window = (sum(1 for x in range(traced.rays) if x <= most) for most in (2, 2))
        assert received.window.sum() == pytest.approx(3.0 * in_window)
        assert received.outside.sum() == pytest.approx(3.0 * (traced.rays - in_window))
        assert received.images.sum() == pytest.approx(3.0 * on_grid)


def test_flux_is_counted_by_its_fate_and_by_what_took_it() -> None:
    fates = np.array([0, 0, 1, 6, 3, 0], dtype=np.int8)
    flux = np.arange(1.0, 7.0)
    taken = np.full(6, 0.25)
    glass = np.full(6, 0.5)
    none = np.zeros((6, 3))
    exits = ExitRays(none, none, flux, np.zeros(6), fates, taken, glass)
    missed = np.array([False, True, False, False, False, True])
    by_fate = flux_by_fate(exits, missed)
    assert by_fate.tolist() == [1.0, 3.0, 0.0, 5.0, 0.0, 0.0, 4.0, 0.0, 0.0, 2.0 + 6.0, 6 * 0.25, 6 * 0.5, 0.0, 0.0]
    plain = flux_by_fate(replace(exits, absorbed=None, lost_in_glass=None), missed)
    assert plain.tolist() == [*by_fate[:10], 0.0, 0.0, 0.0, 0.0]


def exit_rays(shift: float = 0.0, count: int = 16) -> ExitRays:
    """Rays to the plane at 10 mm, at random on it and beyond; every fifth is lost, and one goes down."""
    chance = np.random.default_rng(0)
    points = chance.uniform(-1.0, 1.0, (count, 3))
    slopes = (chance.uniform(-4.0, 4.0, (count, 2)) + shift) / 10.0
    directions = np.column_stack([slopes, np.ones(count)])
    directions[1, 2] = -1.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fates = np.where(np.arange(count) % 5 == 4, int(Fate.BASE), int(Fate.LEFT_LENS)).astype(np.int8)
    flux = chance.uniform(0.5, 1.0, count)
    return ExitRays(points, directions, flux, np.zeros(count), fates)


def test_tables_of_a_lens_state_their_error_in_nanometres() -> None:
    lens = Lens.double(random_surface(1, 3.0, 0.01, (9,)), sphere(6.0), small_spec(), 0, "draft")
    traced = TracedLens.of(lens, 2.0)
    for name, table in zip(("inner", "outer"), traced.tables, strict=True):
        error_mm = table_error(traced.scene.grid, table, getattr(lens, name))
        assert traced.table_error_nm[name] == pytest.approx(error_mm * 1e6, rel=1e-12)
    assert simulation.REPLICATES == 16
