"""What a further thing costs: the files that CONTRIBUTING names, and a kind of face that the package does not know."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from chains import clear, tables_of, upwards
from presets import FEW
from tir_lenses import spot_lens

from lensforge.cad.body_export import build_body, prove
from lensforge.kernels.fate import Fate
from lensforge.light.evaluation import evaluate_lens
from lensforge.light.simulation import TracedLens, simulate
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import BODY, CAVITY, OUTSIDE
from lensforge.proof.proof_inputs import optical_of
from lensforge.proof.sequential_cast import CastFate
from lensforge.proof.verification import passage_through
from lensforge.scene.body import Body, Face
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.receiver import ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reciprocal import ReciprocalSurface

ROOT = Path(__file__).parents[1]


def test_each_thing_to_add_touches_six_files_at_most_and_they_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:3] for line in text.splitlines() if re.match(r"\| an? ", line)]
    assert {"a kind of face", "a kind of lens", "a body", "a receiver", "a source", "a ray-file format"} <= {
        row[0].strip() for row in rows
    }
    for thing, places in rows:
        named = re.findall(r"`((?:lensforge|docs|examples)/[\w./]+)`", places)
        assert len(named) <= 6, thing
        assert [place for place in named if not (ROOT / place).exists() and "NAME" not in place] == [], thing


@dataclass(frozen=True)
class Roof(ReciprocalSurface):
    """A pyramid's four planes, rounded into one another: a kind of face of a user's own."""

    height_mm: float = 8.0

    @property
    def symmetry(self) -> str:
        return "none"

    def reciprocal(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``(z + (x^4 + y^4)/4) / h``."""
        x, y, z = directions.T
        slope = np.stack([x**3, y**3, np.ones_like(z)], axis=1) / self.height_mm
        return (z + 0.25 * (x**4 + y**4)) / self.height_mm, slope


def test_a_face_of_a_kind_of_ones_own_is_traced_exported_and_cast() -> None:
    body = Body(
        (
            Face("cap", sphere(4.0), CAVITY, BODY),
            Face("shell", sphere(9.0), BODY, OUTSIDE),
            Face("roof", Roof(12.0), BODY, OUTSIDE),
        )
    )
    media, rays, grid = clear(), upwards(200, 3, 0.5), TableGrid(401)
    traced = TracedLens.of_body(body, media, 3, 8.0)
    assert set(traced.table_error_nm) == {"cap", "shell", "roof"}
    design = TracedBundle.of(tables_of(body, grid), Scene(media, grid, True, None, body.chain(3)), rays)
    assert {0, 4, 8} <= set((design.met[design.met >= 0] // 4 * 4).tolist())
    built = build_body(body, rings=64)
    files = built.files("roof")
    proof = prove(built, *files)
    assert proof.solid.valid and proof.stl.watertight
    assert max(error.form_max_nm for error in proof.form.values()) < 1.0
    found = passage_through(files[0], optical_of(body, 3), media, rays)
    left = design.exits.fates == Fate.LEFT_LENS
    assert np.array_equal(found.fates == CastFate.LANDED, left) and left.sum() > 100
    assert np.linalg.norm(found.points - design.exits.points, axis=1)[left].max() < 1e-5
    assert found.flux[left] == pytest.approx(design.exits.flux[left], rel=1e-4)


@dataclass(frozen=True)
class RingSource:
    """A Lambertian ring about the axis: a source that no spec has."""

    inner_mm: float
    outer_mm: float
    flux_w: float = 2.0
    symmetry: str = "square"
    ray_count: int | None = None

    def sample(self, count: int, seed: int) -> RayBundle:
        place, turn, squared, azimuth = np.random.default_rng(seed).random((4, count))
        radius = np.sqrt(self.inner_mm**2 + place * (self.outer_mm**2 - self.inner_mm**2))
        origins, directions = (
            np.column_stack([size * np.cos(2.0 * np.pi * at), size * np.sin(2.0 * np.pi * at), up])
            for size, at, up in ((radius, turn, np.zeros(count)), (np.sqrt(squared), azimuth, np.sqrt(1.0 - squared)))
        )
        return RayBundle(origins, directions, np.full(count, self.flux_w / count))

    def outline(self) -> np.ndarray:
        turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        return self.outer_mm * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])


def _cone(
    points: np.ndarray, along: np.ndarray, pose: np.ndarray, _: float, hits: np.ndarray, reached: np.ndarray
) -> None:
    """The cone r = z of the pose, unrolled: slant height times azimuth over root 2, about its z axis."""
    p, d = (points - pose[0]) @ pose[1:].T, along @ pose[1:].T
    square, half, rest = (a[:, 2] * b[:, 2] - (a[:, :2] * b[:, :2]).sum(1) for a, b in ((d, d), (p, d), (p, p)))
    path = (-half - np.sqrt(np.maximum(half**2 - square * rest, 0.0))) / square
    x, y, z = (p + path[:, None] * d).T
    reached[:] = (path > 0.0) & (z > 0.0)
    turn = np.arctan2(y, x) / np.sqrt(2.0)
    hits[:] = np.sqrt(2.0) * z[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


@dataclass(frozen=True)
class Cone(Plane):
    """A receiver that no spec has: a cone about the axis, opening upwards, unrolled."""

    kernels: ClassVar = (_cone, None)


def test_a_source_and_a_receiver_of_ones_own_are_lit_and_cast() -> None:
    source, lens = RingSource(0.4, 0.8), spot_lens()
    light = evaluate_lens(lens, source, FEW, rays=2**13)
    assert sum(vars(light.flux).values()) == pytest.approx(1.0, abs=1e-12)
    assert 0.3 < light.efficiency.value < light.possible.efficiency
    body = Body((Face("inside", sphere(4.0), CAVITY, BODY), Face("outside", sphere(9.0, 1.0), BODY, OUTSIDE)))
    traced, side = TracedLens.of_body(body, clear(), 2, 6.0), 400.0
    pose = ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, -15.0))  # its apex below the lens: it stands around it
    cone = Cone(pose, PixelGrid.of(side, side, 40), Window(side, side))
    found, exits = simulate(traced, source, (cone,), 2**15, 3).received[0], traced.trace(source.sample(2**15, 4))
    steep = exits.left_lens & (np.hypot(*exits.directions[:, :2].T) > exits.directions[:, 2])
    landed = (found.window + found.outside).mean() / source.flux_w
    assert 0.2 < landed == pytest.approx(exits.flux[steep].sum() / source.flux_w, abs=4.0 / np.sqrt(2**15))
    rays = source.sample(200, 5)
    cast = passage_through(build_body(body, rings=64).files("ring")[0], optical_of(body), clear(), rays)
    assert np.array_equal(cast.fates == CastFate.LANDED, traced.trace(rays).left_lens)
