"""Limits of any lens: how far two refractions turn a ray, how much they transmit, and the étendue they conserve.

The light of the source is unpolarised. What two faces transmit is the most where both turn a ray in one plane: half of
the sum over both polarisations of the product of what either transmits, at most the product of the root mean squares
(Cauchy and Schwarz), and no less where two that are alike share the turn. In air both faces are alike; where something
else fills the cavity or surrounds the lens, each has its own ratio of indices. A coated face is only known to reflect
at least so much, at any angle; it turns light as if it were bare.

Étendue (mm^2 sr) is in air. Sources: Winston, Minano and Benitez, *Nonimaging Optics* (2005), chapter 2, for
conservation; the projected solid angle of a sphere seen from a small area is ``pi (r/D)^2 cos(angle)``, Howell's
catalogue of view factors, B-42.
"""

from math import pi, prod

import numpy as np
from jaxtyping import Bool, Float

from lensforge.optics.coatings import Span, least_reflectances
from lensforge.optics.face_roles import BODY, CAVITY, bounding
from lensforge.optics.media import Media, Mirror

Turns = Float[np.ndarray, "*n"]
Ways = tuple[float | None, ...]  # reflectances of the faces by which light may pass; None: one that is bare
Least = tuple[Ways, Ways]  # of those by which it may enter the body, and leave it
BY_SYMMETRY = "the symmetry of faces of revolution"  # a law, and what there is to change
LEVELS = "lens.levels, such as [25]: faces of revolution make round light about the axis"
_PEAKED = 2.5  # ratio of indices up to which a face transmits the most where it turns no light
_TURNS = 128  # of a face at which others are looked at
_BETWEEN = 1.0001  # bound of the points between them
_SPLITS = 512  # of a turn among two faces that differ: the bound is less than 3 % above what some split transmits


def best_transmittance(
    deviation_rad: Turns,
    refractive_index: float | Turns,
    cavity_index: float = 1.0,
    outside_index: float = 1.0,
    least: Least = ((None,), (None,)),
) -> Turns:
    """Largest transmittance of two faces that turn a ray by ``deviation_rad`` at least; 0 beyond the largest deviation.

    The logarithm of one face's root mean square is concave in its deviation, so that two alike do best to turn the ray
    by half of it each, in one plane. Of two that differ an upper bound: each transmits less the more it turns, and
    within a step of the split at most what it does at the step's better end. ``least``: of :func:`least_by_way`.
    """
    turn = np.maximum(deviation_rad, 0.0)
    index = np.broadcast_to(refractive_index, turn.shape)
    if cavity_index == outside_index and {*least[0], *least[1]} == {None}:
        once = _of_bare(0.5 * turn, _ratio(index, cavity_index))
        return once * once
    # once for all rays of one index that need not turn: in a scene they are most of all
    pairs, places = np.unique(np.stack([turn.ravel(), index.ravel()]), axis=1, return_inverse=True)
    turns, first, second = pairs[0], *(_ratio(pairs[1], index) for index in (cavity_index, outside_index))
    bound: Turns = np.zeros_like(turns)
    for k in range(_SPLITS):
        at_first = _at_most(k / _SPLITS * turns, first, least[0])
        at_second = _at_most((1.0 - (k + 1) / _SPLITS) * turns, second, least[1])
        bound = np.maximum(bound, at_first * at_second)
    return bound[places.ravel()].reshape(turn.shape)


def least_by_way(media: Media, span_nm: Span | None) -> Least:
    """Least reflectances of the faces by which light may enter the body, and of those by which it may leave.

    Without mirrors. ``span_nm`` None: at any wavelength.
    """
    coated = least_reflectances(media, span_nm)
    mirrors = {coating.face for coating in media.coatings if isinstance(coating.coating, Mirror)}
    entering, leaving = (
        tuple(coated.get(face.name) for face in bounding(media.faces, medium) if face.name not in mirrors)
        for medium in (CAVITY, BODY)
    )
    return entering, leaving


def _at_most(deviation_rad: Turns, ratio: Turns, ways: Ways) -> Turns:
    """Largest transmittance of the best of some faces, turning light at least so far; with coatings a bound."""
    turned = _is_turned(deviation_rad, ratio)
    best = _of_bare(deviation_rad, ratio) if None in ways else np.zeros_like(ratio)
    for least in ways:
        best = best if least is None else np.maximum(best, np.where(turned, 1.0 - least, 0.0))
    return best


def _of_bare(deviation_rad: Turns, ratio: Turns) -> Turns:
    bare = face_transmittance(deviation_rad, ratio)
    peaked = ratio > _PEAKED
    for share in np.linspace(0.0, 1.0, _TURNS if np.any(peaked) else 0):  # the most is near Brewster's angle
        turn = share * np.arccos(1.0 / ratio)
        bare = np.where(
            peaked & (turn >= deviation_rad), np.maximum(bare, _BETWEEN * face_transmittance(turn, ratio)), bare
        )
    return bare


def _is_turned(deviation_rad: Turns, ratio: float | Turns) -> Bool[np.ndarray, "*n"]:
    """True if a face can turn light by that much."""
    return (ratio * np.cos(deviation_rad) > 1.0) | (deviation_rad == 0.0)


def _ratio(refractive_index: Turns, around: float) -> Turns:
    """Ratio of the indices at a face, at least 1: the reversed light path transmits as much."""
    ratio = refractive_index / around
    return np.maximum(ratio, 1.0 / ratio)


def face_transmittance(deviation_rad: Turns, refractive_index: float | Turns) -> Turns:
    """Rms transmittance of s and p of a face that turns light by ``deviation_rad``; 0 if it cannot.

    ``i``, the angle in air, has ``sin i = n sin(i - d)``, so ``tan i = n sin d / (n cos d - 1)``; then Fresnel's
    formulas (Born and Wolf, Principles of Optics, 1.5.2).
    """
    index = np.asarray(refractive_index, dtype=np.float64)
    below = index * np.cos(deviation_rad) - 1.0
    air = np.arctan2(index * np.sin(deviation_rad), np.maximum(below, 0.0))
    cosine = np.cos(air)
    inside = np.cos(air - deviation_rad)
    with np.errstate(invalid="ignore", divide="ignore"):
        r_s = (cosine - index * inside) / (cosine + index * inside)
        r_p = (index * cosine - inside) / (index * cosine + inside)
        transmitted: Turns = np.sqrt(0.5 * ((1.0 - r_s**2) ** 2 + (1.0 - r_p**2) ** 2))
    return np.where(_is_turned(deviation_rad, refractive_index), transmitted, 0.0)


def transmittance_of(media: Media) -> float:
    """Most that both faces transmit: it bounds a lens's efficiency, 0.923 for PMMA in air, at normal incidence.

    Of a coated face at the angle and wavelength at which it reflects least; for indices above 2.6 near Brewster's.
    Light leaves a reflector without any loss where it leaves directly: 1. Bodies behind the lens count likewise.
    """
    behind = prod((transmittance_of(body.media(media)) for body in media.bodies), start=1.0)
    if media.exit_mirror is not None:
        return behind
    index = np.full(1, media.body.refractive_index)
    sides = zip(least_by_way(media, None), (media.cavity_index, media.outside_index), strict=True)
    inner, outer = (float(_at_most(np.zeros(1), _ratio(index, around), ways)[0]) for ways, around in sides)
    return inner * outer * behind


def cell_solid_angles(corners: Float[np.ndarray, "m n 3"]) -> Float[np.ndarray, "k l"]:
    """Solid angles (sr), from the origin, of the cells [row, column] between ``corners``: points or directions.

    Each cell counts as two flat triangles, whose solid angle is exact (Van Oosterom and Strackee, IEEE Trans. Biomed.
    Eng. 30 (1983) 125): exact on a plane, right to the square of a cell's angle elsewhere.
    """
    units = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    a = units[:-1, :-1]
    b = units[:-1, 1:]
    c = units[1:, 1:]
    d = units[1:, :-1]
    return _triangles(a, b, c) + _triangles(a, c, d)


def _triangles(
    a: Float[np.ndarray, "k l 3"], b: Float[np.ndarray, "k l 3"], c: Float[np.ndarray, "k l 3"]
) -> Float[np.ndarray, "k l"]:
    """Solid angles of triangles of unit vectors; the volume from differences keeps the digits of small ones."""
    volume = np.abs(np.sum(a * np.cross(b - a, c - a), axis=-1))
    cosines = 1.0 + np.sum(a * b, axis=-1) + np.sum(b * c, axis=-1) + np.sum(c * a, axis=-1)
    return 2.0 * np.arctan2(volume, cosines)


def etendue_from_ball(radius_mm: float, solid_angle_sr: float) -> float:
    """Étendue (mm^2 sr) of all light from a ball about the origin to a part of a surface that lies outside the ball.

    From a point of the surface at distance D, seen at the angle t from its normal, the ball fills the projected solid
    angle ``pi (r/D)^2 cos t``. Over an area dA that is ``pi r^2 dA cos t / D^2``, and ``dA cos t / D^2`` is the solid
    angle of dA from the ball's centre: the integral is ``pi r^2`` times the solid angle of the part. In the far field
    ``pi r^2`` is what the ball shows to each direction.
    """
    return pi * radius_mm**2 * solid_angle_sr


def cone_around(
    corners: Float[np.ndarray, "m n 3"], cells: Bool[np.ndarray, "k l"]
) -> tuple[Float[np.ndarray, " 3"], float]:
    """Axis (unit vector) and half angle (rad) of a cone from the origin that holds all chosen ``cells``."""
    units = corners / np.linalg.norm(corners, axis=-1, keepdims=True)
    ends = np.concatenate([units[:-1, :-1][cells], units[:-1, 1:][cells], units[1:, 1:][cells], units[1:, :-1][cells]])
    axis = ends.mean(axis=0)
    axis /= np.linalg.norm(axis)
    return axis, float(np.arccos(np.clip(ends @ axis, -1.0, 1.0)).max())
