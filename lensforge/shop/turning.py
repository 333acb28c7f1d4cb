"""The turning tool: what its nose and its flanks reach of a face of revolution, in the plane of its meridian.

As the work turns, all of it sweeps its distance from the axis and its height: the face, those beside it, base and
flange are points (r, z) of a half-plane, and their mirror images those on the other side of the axis, over which the
tool passes. The tool is all that is nearer to a wedge than the radius of its nose: the wedge has its apex in the centre
of the nose, and half its angle is that of a flank to the tool's axis, with the clearance that the flank keeps. The axis
has one tilt for a whole face, towards the axis of the lens or away from it: the one that reaches most. A wedge that
holds the direction of the lens's axis ends at a shank along it, to the side to which it leans.

A nose leaves a fillet where two faces meet in a concave corner: what it misses there is told apart from the rest.
Contacts and obstacles are samples: these are an eighth of the nose apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from lensforge.shop.check_measures import TurningTool
from lensforge.shop.face_check import FaceCheck, bounded
from lensforge.shop.face_samples import OpticalFace
from lensforge.shop.profile_table import way_along
from lensforge.spec import ManufactureSection

Points = Float[np.ndarray, "_ 2"]  # distance from the axis and height (mm)
_STRAIGHT_MM = 1e4  # a wider concave is none: a cone has such, of the noise of its spline
_CONTACTS = 481  # places on a meridian for what the tool reaches
_FINE = 4801  # places on it for slopes and curvatures
_OF_NOSE = 8  # obstacles in a radius of the nose: between them it enters the work by a 500th of that
_GOUGE_MM = 1e-4  # so deep a flank may rub: it keeps its clearance beside
_TILTS = 13  # tried evenly
_ROUNDS = 4  # beside the best one, each time half as far off
_MIRROR = np.array([-1.0, 1.0])
_DIGITS = 6  # of angles in degrees: normals of the export are good to less


@dataclass(frozen=True)
class Meridian:
    """Points of a face in the half-plane of its meridian, by their chart radius; unit normals into the air.

    ``areas`` (mm^2): of the ring of each point. ``curvatures`` (1/mm): of the meridian alone, negative where concave.
    """

    chart: Float[np.ndarray, " k"]
    points: Points
    normals: Points
    areas: Float[np.ndarray, " k"]
    curvatures: Float[np.ndarray, " k"]

    @staticmethod
    def of(face: OpticalFace, count: int) -> "Meridian":
        """``count`` points of ``face``, evenly along the meridian, both ends included."""
        low, high = (float(radius[0]) for radius in face.domain.radii(np.zeros(1)))
        even = np.linspace(low, high, _FINE)
        way = way_along(face.patch.points(_on_meridian(even)))
        chart = np.interp(np.linspace(0.0, way[-1], count), way, even)
        jet = face.patch.jet(_on_meridian(chart))
        normals = face.air_normal(jet)
        areas = 2.0 * np.pi * jet.point[:, 0] * np.gradient(way_along(jet.point))
        areas[[0, -1]] /= 2.0
        curvatures = -np.sum(jet.xx * normals, axis=1) / np.sum(jet.x**2, axis=1)
        return Meridian(chart, jet.point[:, ::2], normals[:, ::2], areas, curvatures)

    @staticmethod
    def near(face: OpticalFace, apart_mm: float) -> Points:
        """Points of ``face`` at most ``apart_mm`` apart, as far as their number allows."""
        length = way_along(Meridian.of(face, _CONTACTS).points)[-1]
        return Meridian.of(face, int(np.clip(np.ceil(length / apart_mm) + 1, _CONTACTS, _FINE))).points


def _on_meridian(chart: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 2"]:
    return np.column_stack([chart, np.zeros(len(chart))])


@dataclass(frozen=True)
class LatheTool:
    """A turning tool: nose radius, width in a bore, angle of its flanks to its axis with clearance, largest tilt."""

    radius_mm: float
    width_mm: float
    flank_rad: float
    most_tilt_rad: float

    @staticmethod
    def of(shop: ManufactureSection) -> "LatheTool":
        """The tool of the spec."""
        flank_rad, most_rad = np.deg2rad([90.0 - shop.steepest_deg, shop.max_tilt_deg]).tolist()
        return LatheTool(shop.nose_radius_mm, shop.shank_width_mm, flank_rad, most_rad)

    def tilts_rad(self, slopes: Float[np.ndarray, " k"]) -> Float[np.ndarray, " t"]:
        """Tilts to try: first the one nearest to all normals at ``slopes`` (rad), then even ones, the least first.

        Only tilts at which the nose has each of the normals, if there are such, else all.
        """
        most = self.most_tilt_rad
        steepest = np.pi / 2.0 - self.flank_rad
        low, high = max(slopes.max() - steepest, -most), min(slopes.min() + steepest, most)
        tilts = np.linspace(low, high, _TILTS) if low <= high else np.linspace(-most, most, _TILTS)
        return np.concatenate([[_middle(slopes, most)], tilts[np.argsort(np.abs(tilts), kind="stable")]])

    def is_clear(self, face: Meridian, upright: float, tilt_rad: float, obstacles: Points) -> Bool[np.ndarray, " k"]:
        """True where flanks and shank of the tool at a point of the face are clear of all obstacles.

        ``upright``: sign of z from the face to the shank of a tool that is not tilted.
        """
        sine, cosine = np.sin(self.flank_rad), np.cos(self.flank_rad)
        axis = np.array([np.sin(tilt_rad), upright * np.cos(tilt_rad)])
        towards = obstacles[None] - (face.points + self.radius_mm * face.normals)[:, None]
        along, across = towards @ axis, np.abs(towards @ np.array([-axis[1], axis[0]]))
        inside = (along * cosine + across * sine > 0.0) & (across * cosine - along * sine < self.radius_mm - _GOUGE_MM)
        if abs(tilt_rad) <= self.flank_rad:
            side = 1.0 if tilt_rad > 0.0 else -1.0
            inside &= side * towards[..., 0] < self.width_mm - self.radius_mm
        return np.asarray(~inside.any(axis=1) & (face.normals @ axis >= sine - 1e-5))

    def nose_enters(self, face: Meridian, obstacles: Points) -> Bool[np.ndarray, " k"]:
        """True where the nose on the face enters an obstacle."""
        if not len(obstacles):
            return np.zeros(len(face.chart), dtype=bool)
        distance, _ = cKDTree(obstacles).query(face.points + self.radius_mm * face.normals)
        return np.asarray(distance < self.radius_mm - _GOUGE_MM)


def _middle(slopes: Float[np.ndarray, " k"], most_rad: float) -> float:
    """Tilt (rad) of a tool's axis that minimises the largest angle to the normals."""
    return float(np.clip((slopes.min() + slopes.max()) / 2.0, -most_rad, most_rad))


@dataclass(frozen=True)
class TurnedFace(FaceCheck):
    """One face, and what a turning tool reaches of it."""

    tool: TurningTool
    meridian: Meridian

    @property
    def cutter(self) -> TurningTool:
        """The record of the tool on it."""
        return self.tool

    def worst_places(self) -> dict[str, Float[np.ndarray, "3"]]:
        """Worst samples: the tightest of the meridian, and the one with the most material left, in the plane y = 0."""
        most_left = self.samples.points[np.argmax(np.nan_to_num(self.residual_mm, nan=np.inf))]
        distance, height = self.meridian.points[np.argmin(self.meridian.curvatures)]
        nose = np.array([distance, 0.0, height])
        return super().worst_places() | {"nose": nose, "turning": most_left, "corner": most_left}


@dataclass(frozen=True)
class _Setup:
    """A face on the lathe: contacts, direction of a shank that is not tilted, slopes of the normals to that (rad).

    ``near``: its obstacles as densely as the nose needs them, ``far``: as the flanks do, on both sides of the axis.
    """

    tool: LatheTool
    contacts: Meridian
    upright: float
    slopes: Float[np.ndarray, " m"]
    near: Points
    far: Points
    corner: Bool[np.ndarray, " k"]

    def share(self, where: Bool[np.ndarray, " k"]) -> float:
        """Share of the area."""
        return float(self.contacts.areas[where].sum() / self.contacts.areas.sum())

    def best(self, fixture: Points) -> tuple[Bool[np.ndarray, " k"], float]:
        """Contacts reached at the best tilt, and that tilt (rad)."""
        far, near = (np.concatenate([points, _both_sides([fixture])]) for points in (self.far, self.near))
        fits = ~self.tool.nose_enters(self.contacts, near)
        tilts = self.tool.tilts_rad(self.slopes)
        reached = np.zeros(len(fits), dtype=bool)
        best_rad = float(tilts[0])
        step = np.ptp(tilts) / (_TILTS - 1)
        for round_ in range(_ROUNDS + 1):
            for tilt_rad in tilts.tolist():
                clear = fits & self.tool.is_clear(self.contacts, self.upright, tilt_rad, far)
                if self.share(clear) > self.share(reached):
                    reached = clear
                    best_rad = tilt_rad
                if (reached | self.corner).all():
                    return reached, best_rad
            most = self.tool.most_tilt_rad
            nearer = best_rad + 0.5 ** (round_ + 1) * step * np.array([-1.0, 1.0])
            tilts = np.clip(nearer, -most, most)
        return reached, best_rad


def turned_face(face: FaceCheck, tool: LatheTool, fixture: Points) -> TurnedFace:
    """The measured ``face`` with the reach of ``tool``; ``fixture``: points of base and flange."""
    optical = face.samples.face
    upright = float(optical.away[2])
    fine = Meridian.of(optical, _FINE)
    contacts = Meridian.of(optical, _CONTACTS)
    slopes = np.arctan2(fine.normals[:, 0], upright * fine.normals[:, 1])
    near = [Meridian.near(part, tool.radius_mm / _OF_NOSE) for part in (optical, *optical.beside)]
    far = [contacts.points, *(Meridian.of(part, _CONTACTS).points for part in optical.beside)]
    corner = tool.nose_enters(contacts, _both_sides(near[1:]))
    setup = _Setup(tool, contacts, upright, slopes, _both_sides(near), _both_sides(far), corner)
    reached, tilt_rad = setup.best(fixture)
    bare = setup.best(fixture[:0])[0] if len(fixture) and not (reached | corner).all() else reached
    left_mm = _left_mm(contacts, reached, tool.radius_mm)
    least = float(fine.curvatures.min())
    steepest = np.abs(slopes - _middle(slopes, tool.most_tilt_rad)).max()
    record = TurningTool(
        radius_mm=tool.radius_mm,
        reachable_fraction=setup.share(reached),
        largest_radius_mm=bounded(-1.0 / least if least < -1.0 / _STRAIGHT_MM else np.inf),
        residual_mm=bounded(float(left_mm.max())),
        slope_deg=round(float(np.degrees(steepest)), _DIGITS),
        tilt_deg=round(float(np.degrees(tilt_rad)), _DIGITS) + 0.0,
        corner_fraction=setup.share(corner & ~reached),
        bare_fraction=setup.share(bare),
    )
    on_samples_mm = np.interp(np.hypot(*face.samples.chart.T), contacts.chart, left_mm)
    return TurnedFace(**{**vars(face), "residual_mm": on_samples_mm}, tool=record, meridian=fine)


def _both_sides(parts: Sequence[Points]) -> Points:
    """Points of all ``parts``, and their mirror images on the other side of the axis."""
    points = np.concatenate([np.empty((0, 2)), *parts])
    return np.concatenate([points, _MIRROR * points])


def _left_mm(face: Meridian, reached: Bool[np.ndarray, " k"], radius_mm: float) -> Float[np.ndarray, " k"]:
    """Height (mm) left uncut over each point; all NaN where the tool reaches nothing."""
    if not reached.any():
        return np.full(len(reached), np.nan)
    centres = (face.points + radius_mm * face.normals)[reached]
    distance, _ = cKDTree(centres).query(face.points)
    return np.where(reached, 0.0, np.maximum(distance - radius_mm, 0.0))
