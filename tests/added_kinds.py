"""One of each kind that a user may add, from outside the package: each registers itself as this module is loaded."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lensforge.optics.arrays import module_of
from lensforge.optics.pose import Vector
from lensforge.proof.proof_inputs import drawn_points
from lensforge.proof.receiver_screen import Screen
from lensforge.scene.pixel_grid import Window
from lensforge.scene.receiver import PosedReceiver, posed_receiver
from lensforge.sources.planar_emitter import area_of
from lensforge.sources.rayfiles.ray_file import FORMATS, Format, RayFile, register
from lensforge.sources.rayfiles.ray_file_rows import FileImage
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.fixed_surface import FixedFace
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.shape_targets import ShapeTarget
from lensforge.spec.source_sections import PlanarSource
from lensforge.spec.spec_section import Millimetres
from lensforge.spec.target_sections import DegreesWide, TargetSection
from lensforge.surfaces.reciprocal import ReciprocalSurface
from lensforge.surfaces.surface import Length, SurfaceRecord, recorded


class StarTarget(ShapeTarget):
    """A star of round points: its rim lies ``radius (1 + cos(points azimuth)) / 2`` from its centre."""

    needs: ClassVar[tuple[str, ...]] = ("radius",)
    phrase: ClassVar[str] = "star of {0.points} points, {radius} long"

    kind: Literal["star"] = "star"
    points: Annotated[int, Field(ge=3, le=12)] = 5
    """Points of the star."""
    radius_mm: Millimetres | None = None
    """Length of a point from the centre on a surface."""
    radius_deg: DegreesWide | None = None

    @property
    def bounds(self) -> tuple[float, float]:
        return 2.0 * self.size("radius"), 2.0 * self.size("radius")

    def contains(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.hypot(x, y) <= 0.5 * self.size("radius") * (1.0 + np.cos(self.points * np.arctan2(y, x)))


class RingSource(PlanarSource):
    """A uniform ring about the axis."""

    phrase: ClassVar[str] = "{0.outer_mm:g} mm ring source"

    kind: Literal["ring"] = "ring"
    inner_mm: Millimetres
    """Diameter within which it is dark."""
    outer_mm: Millimetres
    """Diameter of all of it."""

    @property
    def extent_mm(self) -> float:
        return 0.5 * self.outer_mm


@dataclass(frozen=True)
class RingArea:
    """The ring between two radii (mm)."""

    inner_mm: float
    outer_mm: float
    symmetry: str = "square"

    def place(self, points: np.ndarray) -> np.ndarray:
        inner, outer = self.inner_mm**2, self.outer_mm**2
        radius, azimuth = np.sqrt(inner + points[:, 0] * (outer - inner)), 2.0 * np.pi * points[:, 1]
        return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=1)

    def density(self, points: np.ndarray) -> np.ndarray:
        radius = np.hypot(*points.T)
        return ((radius >= self.inner_mm) & (radius <= self.outer_mm)) / (np.pi * (self.outer_mm**2 - self.inner_mm**2))

    def corners(self) -> np.ndarray:
        azimuth = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
        return self.outer_mm / np.cos(np.pi / 32) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)


area_of.register(RingSource, lambda spec: RingArea(0.5 * spec.inner_mm, 0.5 * spec.outer_mm))


@drawn_points.register
def _(section: RingSource, random: np.random.Generator, count: int) -> np.ndarray:
    square = random.uniform(-0.5, 0.5, (20 * count, 2)) * section.outer_mm
    radius = np.hypot(*square.T)
    return square[(radius > 0.5 * section.inner_mm) & (radius < 0.5 * section.outer_mm)][:count]


class GableReceiver(ReceiverSection):
    """A roof of two slopes over the lens, its ridge along y, unfolded."""

    phrase: ClassVar[str] = "on a gable at {0.ridge_mm:g} mm"
    facing: ClassVar[Vector] = (0.0, 0.0, 1.0)

    kind: Literal["gable"] = "gable"
    ridge_mm: Millimetres
    """Height of the ridge."""
    width_mm: Millimetres
    """Both slopes together, across the ridge."""
    depth_mm: Millimetres
    """Length of the ridge."""
    pitch_deg: Annotated[float, Field(ge=0.0, le=60.0)]
    """Angle by which each slope falls."""

    @property
    def centre_mm(self) -> Vector:
        return 0.0, 0.0, self.ridge_mm

    @property
    def size(self) -> tuple[float, float]:
        return self.width_mm, self.depth_mm

    def clear_mm(self, place_mm: Vector) -> float:
        pitch = np.radians(self.pitch_deg)
        return float((self.ridge_mm - place_mm[2]) * np.cos(pitch) - abs(place_mm[0]) * np.sin(pitch))


@dataclass(frozen=True)
class Gable(PosedReceiver):
    """The gable about its ridge: rays from within leave by the slope that they meet first."""

    pitch_rad: float = field(kw_only=True)

    def _paths(self, points, directions):
        xp, (sine, cosine) = module_of(points), (np.sin(self.pitch_rad), np.cos(self.pitch_rad))

        def until(side):
            rise = side * sine * directions[:, 0] + cosine * directions[:, 2]
            away = side * sine * points[:, 0] + cosine * points[:, 2]
            return xp.where(rise > 1e-12, -away / xp.where(rise > 1e-12, rise, 1.0), np.inf)

        return xp.minimum(until(1.0), until(-1.0))

    def _reached(self, points, directions):
        paths = self._paths(points, directions)
        return (paths > 0.0) & (paths < np.inf)

    def _chart(self, points, directions):
        ends = points + self._paths(points, directions)[:, None] * directions
        return module_of(ends).stack([ends[:, 0] / np.cos(self.pitch_rad), ends[:, 1]], 1)

    def _local(self, x, y):
        return np.stack([x * np.cos(self.pitch_rad), y, -np.abs(x) * np.sin(self.pitch_rad)], axis=-1)


posed_receiver.register(
    GableReceiver,
    lambda section, pose, grid: Gable(pose, grid, Window(*section.size), pitch_rad=np.radians(section.pitch_deg)),
)


class GableScreen(Screen, kind="gable"):
    """The gable as verification sees it: two planes, each turned until it is level."""

    def _turned(self, side: float) -> np.ndarray:
        angle = side * np.radians(self.numbers["pitch_deg"])
        return np.array([[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]])

    def _landed(self, away: np.ndarray, along: np.ndarray) -> np.ndarray:
        hits = np.full((len(away), 2), np.nan)
        for side in (1.0, -1.0):
            start, way = away @ self._turned(side).T, along @ self._turned(side).T
            place = start - (start[:, 2:] / way[:, 2:]) * way
            here = (way[:, 2] > 0.0) & (start[:, 2] < 0.0) & (side * place[:, 0] >= 0.0)
            hits[here] = place[here, :2]
        return hits

    def _surface(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        flat, up = np.stack([x, y, 0.0 * x], axis=-1), np.array([0.0, 0.0, 1.0])
        right = (x >= 0.0)[..., None]
        points, normals = (
            [vectors @ self._turned(side) for side in (1.0, -1.0)]
            for vectors in (flat, np.broadcast_to(up, flat.shape))
        )
        return np.where(right, *points), np.where(right, *normals)


@recorded("spheroid", "A given face: a spheroid about the origin.")
@dataclass(frozen=True)
class Spheroid(ReciprocalSurface):
    """A spheroid about the origin, by its semi-axes (mm)."""

    across_mm: Length
    up_mm: Length

    @property
    def symmetry(self) -> str:
        return "square"

    def reciprocal(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scaled = directions / np.array([self.across_mm, self.across_mm, self.up_mm]) ** 2
        value = np.sqrt(np.sum(scaled * directions, axis=1))
        return value, scaled / value[:, None]


class FixedSpheroid(FixedFace):
    """Spheroid about the origin."""

    form: ClassVar[str] = "spheroid"

    kind: Literal["spheroid"] = "spheroid"
    across_mm: Millimetres
    """Semi-axes across the axis."""
    up_mm: Millimetres
    """Semi-axis along the axis."""

    @property
    def surface(self) -> Spheroid:
        return Spheroid(4.0 * max(self.across_mm, self.up_mm), self.across_mm, self.up_mm)


def _decode(image: FileImage) -> RayFile:
    rows = np.array([line.split() for line in bytes(image.part(0, image.size)).splitlines()[1:]], dtype=np.float64)
    return RayFile(rows[:, :3], rows[:, 3:6], rows[:, 6], "W", format="sevens")


def _encode(rayfile: RayFile) -> Iterator[bytes]:
    yield b"SEVENS\n"
    for block in rayfile.absolute_blocks():
        for row in np.column_stack([block.positions_mm, block.directions, block.flux]).tolist():
            yield (" ".join(map(repr, row)) + "\n").encode()


SEVENS = register(
    Format("sevens", "seven numbers", (".sevens",), lambda head, _: head.startswith(b"SEVENS\n"), _decode, _encode)
)
ADDED = {TargetSection: "star", EmitterSection: "ring", ReceiverSection: "gable", FixedFace: "spheroid"}


@contextmanager
def forgotten_at_the_end() -> Iterator[None]:
    """A block after which the package does not know these kinds any more."""
    yield
    for base, kind in {**ADDED, SurfaceRecord: "spheroid"}.items():
        del base.kinds[kind]
        base.build_holders_again()
    del Screen.kinds["gable"], FORMATS[SEVENS.name]
