"""A linear lens with reflecting walls: its light by a tracer of the section, by the reference, and what it keeps."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
import torch
from chains import MixedLight
from landed import by_kernels, in_torch, on_device

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.media import Media, Medium
from lensforge.scene.body import Chain
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.collimator import Collimator
from lensforge.surfaces.drawn_profile import DrawnPart, in_section

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
    cap = tuple(
        height * ways[low] * (INDEX - 1.0) / (INDEX * ways[low, 1:] - 1.0 + 0.3) for height in (3.1, 3.1)
    )
    slant = tuple(ways[low] * 9.4 / (ways[low, 1:] + tilt * ways[low, :1]) for tilt in (0.05, -0.05))
    return {"cap": both(cap, 6.0), "side": both(side, 6.0), "wall": both((wall[0], wall[1]), reach),
            "exit": both(slant, reach)}  # fmt: skip


FACES = crooked()


def led(count: int, seed: int = 0, spread: float = 0.6) -> RayBundle:
    """Rays upwards from a rectangle that lies along y, beside the y axis."""
    rng = np.random.default_rng(seed)
    origins = np.column_stack(
        [0.2 + spread * (rng.random(count) - 0.5), 60.0 * (rng.random(count) - 0.5), 0.0 * rng.random(count)]
    )
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = np.abs(directions[:, 2])
    return RayBundle(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True), rng.random(count))


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
