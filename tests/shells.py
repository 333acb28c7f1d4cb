"""Shells behind a lens for tests, and the light through spheres with its polarisation, written by hand."""

import numpy as np

from lensforge.optics.media import Medium, SecondaryOptic
from lensforge.optics.pose import ORIGIN, Pose
from lensforge.surfaces.asphere import Asphere, sphere

N, COVER_N, LOSS, COVER_LOSS = 1.49, 1.586, 0.01, 0.004
TURN = Pose.of_tilts(tilt_deg=(-10.0, 6.0))


def placed(name: str, shells: tuple[Asphere, Asphere], centre=ORIGIN, turn=TURN, **fields) -> SecondaryOptic:
    return SecondaryOptic(name, fields.pop("medium", Medium(COVER_N, COVER_LOSS)), *shells, turn.at(centre), **fields)


SHELL = sphere(12.0), sphere(14.5)
DOME = placed("dome", (sphere(20.0), sphere(21.5, 0.8)), (1.5, -2.0, -1.0))
BOWL = placed("bowl", (Asphere(29.0, -30.0, 0.4), Asphere(32.5, -31.0, 0.2)), (-2.0, 1.0, -3.0), TURN.inverse)


SECOND = placed("second", (sphere(30.0, -2.0), sphere(33.0)), (3.0, 2.0, 0.5), TURN.inverse)


def spheres_of(body: SecondaryOptic) -> list[tuple]:
    """The faces of a body of spheres for :func:`by_hand`."""
    spheres = []
    for face, before, behind, loss in ((body.inner, 1.0, COVER_N, 0.0), (body.outer, COVER_N, 1.0, COVER_LOSS)):
        radius = -face.radius_mm
        centre = body.pose.points(np.array([0.0, 0.0, face.vertex_mm - radius]))
        spheres.append((centre, radius, before, behind, loss))
    return spheres


def by_hand(points, along, shells):
    """Rays and coherency through spheres (centre, radius, index before and behind, absorption before), outwards."""
    light = np.einsum("ij,n->nij", np.eye(3), np.full(len(points), 0.5))
    light = light - 0.5 * np.einsum("ni,nj->nij", along, along)
    for centre, radius, before, behind, loss in shells:
        apart = points - centre
        b = (apart * along).sum(1)
        path = -b + np.sqrt(b * b - (apart * apart).sum(1) + radius**2)
        points = points + path[:, None] * along
        normal = (points - centre) / radius
        light = light * np.exp(-loss * path)[:, None, None]
        cos_in = (along * normal).sum(1)
        sin_out = before / behind * np.sqrt(1.0 - cos_in**2)
        cos_out = np.sqrt(1.0 - sin_out**2)
        s = np.cross(along, normal)
        s = s / np.linalg.norm(s, axis=1)[:, None]
        p = np.cross(along, s)
        ahead = before / behind * along + (cos_out - before / behind * cos_in)[:, None] * normal
        r_s = (before * cos_in - behind * cos_out) / (before * cos_in + behind * cos_out)
        r_p = (behind * cos_in - before * cos_out) / (behind * cos_in + before * cos_out)
        jones = np.einsum("n,ni,nj->nij", np.sqrt(1.0 - r_s**2), s, s)
        jones += np.einsum("n,ni,nj->nij", np.sqrt(1.0 - r_p**2), np.cross(ahead, s), p)
        light, along = jones @ light @ jones.transpose(0, 2, 1), ahead
    return points, along, np.trace(light, axis1=1, axis2=2)
