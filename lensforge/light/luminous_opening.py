"""Luminous opening of lamps for their files: the faces that emit light, seen along the axis."""

import numpy as np
from jaxtyping import Bool, Float

from lensforge.optics.face_roles import OUTSIDE
from lensforge.scene.body import nearest
from lensforge.scene.lens import Lens
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.spec.lamps_section import Lamps
from lensforge.surfaces.placed_bodies import outside_of

_AZIMUTHS = np.radians(np.arange(0.0, 360.0, 5.0))[:, None]
_POLARS = np.radians(np.linspace(0.0, 90.0, 181))
_HALVINGS = 40  # of the step between two of them, in which a rim lies
_FLAT = 1e-3  # of the width: what rises less above its rim has no height

_Points = Float[np.ndarray, "... 3"]
_Polars = Float[np.ndarray, "a k"]


def luminous_opening(lens: Lens, lamps: Lamps) -> LuminousOpening:
    """The opening of ``lamps`` with ``lens``: a disc for one at the origin, else the bounding box of all.

    Its height is that of the highest exit point, optics behind the lens included, above the lowest rim.
    """
    exits = {kind.kind: _exit(kind) for kind in lens.kinds}
    if lamps.is_single:
        points, rim = exits[lens.kind]
        across = 2.0 * float(np.hypot(points[:, 0], points[:, 1]).max())
        return _with_height(across, across, float(points[:, 2].max() - rim[:, 2].min()), circular=True)
    kind_of = {number: kind.name for kind in lamps.kinds for number in kind.numbers}
    turned: dict[object, _Points] = {}
    ends = np.empty((len(lamps), 3, 3))  # lowest and highest x, y, z of each lamp, and its lowest rim
    for number, lamp in enumerate(lamps.lamps):
        key = kind_of.get(number, lens.kind), lamp.axis, lamp.turn_deg
        if key not in turned:
            points, rim = (lamp.pose.points(exit_mm) - lamp.place_mm for exit_mm in exits[key[0]])
            turned[key] = np.stack([points.min(axis=0), points.max(axis=0), rim.min(axis=0)])
        ends[number] = turned[key] + lamp.place_mm
    low = ends[:, 0].min(axis=0)
    high = ends[:, 1].max(axis=0)
    rims = ends[:, 2].min(axis=0)
    wide = (high - low).tolist()
    high_mm = float(high[2] - rims[2])
    return _with_height(wide[0], wide[1], high_mm, circular=False)


def _with_height(x_mm: float, y_mm: float, z_mm: float, *, circular: bool) -> LuminousOpening:
    height = z_mm if z_mm > _FLAT * max(x_mm, y_mm) else 0.0
    return LuminousOpening.of_area(x_mm, y_mm, (height,) * 4, circular)


def _exit(lens: Lens) -> tuple[_Points, _Points]:
    """Points (mm) by which light leaves the lens and the optics behind it, and those of the lens's rim.

    Light leaves by the opening, if there is one, or by the outer faces that are not mirrors.
    """
    roles = [role for role in lens.spec.lens.body_roles if role.is_open]
    faces = lens.body.cavity
    if not roles:
        outer = (role for role in lens.spec.lens.body_roles if role.behind == OUTSIDE and role.is_optical)
        roles = [role for role in outer if not role.reflects]
        faces = lens.body.envelope
    numbers = [number for number, face in enumerate(faces) if face.name in {role.name for role in roles}]

    def directions_at(polars: _Polars) -> _Points:
        sine = np.sin(polars)
        return np.stack([sine * np.cos(_AZIMUTHS), sine * np.sin(_AZIMUTHS), np.cos(polars)], axis=-1)

    def lit_at(polars: _Polars) -> Bool[np.ndarray, "a k"]:
        return np.isin(nearest(faces, directions_at(polars)), numbers)

    def points_at(polars: _Polars) -> _Points:
        directions = directions_at(polars)
        flat = directions.reshape(-1, 3)
        radius = np.min([faces[number].surface.radius(flat) for number in numbers], axis=0).reshape(polars.shape)
        return radius[..., None] * directions

    everywhere = np.tile(_POLARS, (len(_AZIMUTHS), 1))
    lit = lit_at(everywhere)
    last = lit.shape[1] - 1 - np.argmax(lit[:, ::-1], axis=1)[:, None]
    inside = _POLARS[last]
    beyond = _POLARS[np.minimum(last + 1, lit.shape[1] - 1)]
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + beyond)
        is_lit = lit_at(middle)
        inside = np.where(is_lit, middle, inside)
        beyond = np.where(is_lit, beyond, middle)
    rim = points_at(inside)[lit.any(axis=1), 0]
    return np.concatenate([points_at(everywhere)[lit], rim, *map(outside_of, lens.media.bodies)]), rim
