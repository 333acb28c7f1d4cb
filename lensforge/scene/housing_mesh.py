"""Triangles of the bodies of a ``[[scene]]``, in their own frames."""

from collections.abc import Sequence
from functools import singledispatch
from itertools import product
from math import acos, ceil, pi

import numpy as np
from jaxtyping import Float

from lensforge.spec.housing_sections import HousingBox, HousingCylinder, HousingFile, HousingSection, RoomSide
from lensforge.spec.spec_files import input_hashes
from lensforge.surfaces.solid_file import ANGLE_RAD, SolidMesh, merged, read_solid

_CHORD_MM = 5e-3  # of the facets of a cylinder, whose edges lie on it
_FEWEST = 24  # facets around a cylinder
_MOST = 1440  # around a mirror or a clear body: its facets turn light by up to a quarter of a degree
_WALL_MM = 1.0  # thickness of the sides of a room, which overlap in its corners
_TURNS_LIGHT = ("mirror", "clear")  # surfaces whose normals count
_OF_MIRROR_RAD = 0.01  # between their facets in a STEP file, which turn light by up to as much


def contents_of(sections: Sequence[HousingSection]) -> tuple[str, ...]:
    """Hashes of the files of bodies, by which meshes are cached."""
    return tuple(digest for section in sections for digest in input_hashes(section).values())


def placed_mesh(section: HousingSection) -> SolidMesh:
    """Mesh of a body, in the coordinates of the lens or of all lamps."""
    mesh = mesh_of(section)
    return mesh._replace(vertices=section.pose.points(mesh.vertices))


@singledispatch
def mesh_of(section: HousingSection) -> SolidMesh:
    """Closed mesh of a body in its own frame, its triangles facing outwards.

    A kind of body registers its function here. Raises :class:`InputError` for a file that holds none.
    """
    raise NotImplementedError(f"no body of kind {section.kind}: register a function with mesh_of")


@singledispatch
def measured_mesh(section: HousingSection) -> SolidMesh:
    """The part of the surface of a body on which light is measured, in its own frame: by default all of it."""
    return mesh_of(section)


@mesh_of.register
def _(section: HousingBox) -> SolidMesh:
    return _box(0.5 * np.array(section.size_mm))


@mesh_of.register
def _(section: RoomSide) -> SolidMesh:
    facing = np.array(section.facing)
    half = 0.5 * np.array(section.size_mm)
    wall = _box(np.where(facing != 0.0, 0.5 * _WALL_MM, half + _WALL_MM))
    return wall._replace(vertices=wall.vertices - (half + 0.5 * _WALL_MM) * facing)


@measured_mesh.register
def _(section: RoomSide) -> SolidMesh:
    """Its face, without the parts of the wall that others hide."""
    facing = np.array(section.facing)
    half = 0.5 * np.array(section.size_mm)
    room = _box(half)
    a, b, c = np.moveaxis(room.vertices[room.triangles], 1, 0)
    outwards = np.cross(b - a, c - a)
    (behind,) = np.nonzero(outwards @ facing < 0.0)
    return SolidMesh(room.vertices, room.triangles[behind, ::-1])


def _box(half: Float[np.ndarray, "3"]) -> SolidMesh:
    """The box about the origin with half as long sides."""
    corners = half * np.array(list(product((-1.0, 1.0), repeat=3)))
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    halves = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return SolidMesh(corners, np.array(halves))


@mesh_of.register
def _(section: HousingCylinder) -> SolidMesh:
    half = 0.5 * section.length_mm
    profile = [
        (section.bore_radius_mm, -half),
        (section.radius_mm, -half),
        (section.radius_mm, half),
        (section.bore_radius_mm, half),
    ]
    share = min(_CHORD_MM / section.radius_mm, 1.0)
    fewest = _MOST if section.surface in _TURNS_LIGHT else _FEWEST
    sides = min(max(pi / acos(1.0 - share), fewest), _MOST)
    return _turned(np.array(profile), 8 * ceil(sides / 8))  # with the mirrors of a square


@mesh_of.register
def _(section: HousingFile) -> SolidMesh:
    return read_solid(section.file, _OF_MIRROR_RAD if section.surface in _TURNS_LIGHT else ANGLE_RAD)


def _turned(profile: Float[np.ndarray, "k 2"], sides: int) -> SolidMesh:
    """The closed ``profile`` (distance from the axis, height), turned about the z axis, in ``sides`` facets."""
    angles = 2.0 * pi * np.arange(sides) / sides
    radius, height = profile.T
    rings = np.stack(
        [
            radius * np.cos(angles)[:, None],
            radius * np.sin(angles)[:, None],
            np.broadcast_to(height, (sides, len(height))),
        ],
        axis=2,
    )
    along = np.roll(rings, -1, axis=0)
    quads = rings, along, np.roll(along, -1, axis=1), np.roll(rings, -1, axis=1)
    a, b, c, d = (corner.reshape(-1, 3) for corner in quads)
    return merged(np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))
