"""Table of a whole turn over C and gamma from the half-planes of a file, and from photometric types A and B.

Mirror images are added, the turn is closed, noise below 0 is clipped.

LM-63-02, section 3: the planes of types A and C share a vertical axis, those of type B a horizontal one; in types B
and C, H = 0 and V = 0 is the vertical direction and H = 0 and V = 90 the horizontal direction of C = 0; H runs
clockwise, C counterclockwise. So with k the direction of gamma = 0, i that of C = 0 and j that of C = 90 (all at
gamma = 90), the direction of V and H is

    type B    cos H (cos V k + sin V i) - sin H j       V turns about the axis j, H is the latitude on it
    type A    cos V (cos H k - sin H j) + sin V i       H turns about the axis i, V is the latitude on it

Type A is defined there with its direction V = H = 0 in the horizontal; it is that in which a head lamp shines, and here
gamma = 0, as in type B. Both types end at 90 degrees: no light goes backwards.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.photometric.candela_table import CandelaTable, flux_up_to
from lensforge.sources.photometric.photometric_file import HUGE, MOST_GAMMAS, MOST_PLANES, SMALLEST

# Share of the largest intensity. Goniophotometers leave some 0.1 % of it below 0 where stray light is taken off (-0.02
# cd in files of 10 cd and more); ten times that is no noise but a damaged number.
_MOST_BELOW_ZERO = 0.01
_FINEST_DEG = 1e-4  # files state angles to 0.001 degrees; flux over less is rounding
_SAME_PLANE = 1e-3  # of the largest intensity, by which C 360 may differ from C 0, the same half-plane
_SAME_POLE = 0.01  # of the largest intensity, by which half-planes may differ in the direction that they share
_WIDEST_GAP = 90.0  # degrees that a file may leave open before C 360; wider than that and its steps, it lacks planes


def tabulated(
    c_deg: Float[np.ndarray, " c"], gamma_deg: Float[np.ndarray, " g"], candela: Float[np.ndarray, "c g"], name: str
) -> tuple[CandelaTable, tuple[str, ...]]:
    """Make the table, and the warnings on it; ``name`` is the file in errors.

    Raises :class:`InputError` for angles that do not rise within a turn, or leave part of it out, and for intensities
    further below 0 than noise.
    """
    require_angles(c_deg, gamma_deg, name)
    for label, angles, most in (("C", c_deg, 360.0), ("gamma", gamma_deg, 180.0)):
        if angles[0] < 0.0 or angles[-1] > most:
            raise InputError(f"{name}: its {label} angles must rise within 0 to {most:g}; export it again")
    c_deg = np.where(c_deg < _FINEST_DEG, 0.0, np.where(c_deg > 360.0 - _FINEST_DEG, 360.0, c_deg))  # on the seam
    if len(gamma_deg) < 2:
        raise InputError(f"{name}: one gamma angle only; a far field needs two or more")
    candela, warnings = not_below_zero(candela, name)
    if len(c_deg) == 1 and c_deg[0] != 0.0:
        warnings = (*warnings, f"its only half-plane is C {c_deg[0]:g}: taken as light of revolution")
    candela, seam = _one_seam(c_deg, candela)
    if seam > _SAME_PLANE:
        line = f"its half-planes C 0 and C 360, which are one, differ by {seam:.2g} of the largest: their mean is taken"
        warnings = (*warnings, line)
    c_deg, candela = _whole_turn(c_deg, candela, name)
    table = CandelaTable(c_deg, gamma_deg, candela)
    if not table.flux() > SMALLEST:
        raise InputError(f"{name}: its intensities hold no flux, gamma {gamma_deg[0]:g} to {gamma_deg[-1]:g}")
    return table, (*warnings, *_pole_warnings(table))


def _pole_warnings(table: CandelaTable) -> Iterator[str]:
    """Warnings if half-planes have different intensities at gamma 0 or 180, each a single direction."""
    for gamma, values in ((0.0, table.values[:, 0]), (180.0, table.values[:, -1])):
        if gamma in table.gamma_deg and np.ptp(values) > _SAME_POLE * table.values.max():
            yield (
                f"at gamma {gamma:g}, one direction, its half-planes have {values.min():.4g} to {values.max():.4g} cd: "
                f"each is taken as it stands, their mean is {table.pole_mean(gamma):.4g} cd"
            )


def _one_seam(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"]
) -> tuple[Float[np.ndarray, "c g"], float]:
    """Intensities with C 0 and C 360 set to their mean, and their largest difference over the largest intensity."""
    difference = float(np.abs(candela[-1] - candela[0]).max() / candela.max())
    if (c_deg[0], c_deg[-1]) != (0.0, 360.0) or difference == 0.0:
        return candela, 0.0
    mean = 0.5 * (candela[:1] + candela[-1:])
    return np.concatenate([mean, candela[1:-1], mean]), difference


def require_angles(planes_deg: Float[np.ndarray, " c"], angles_deg: Float[np.ndarray, " g"], name: str) -> None:
    """Raise :class:`InputError` for angles that do not rise, lie too close, or are more than any instrument has."""
    for angles, most in ((planes_deg, MOST_PLANES), (angles_deg, MOST_GAMMAS)):
        if len(angles) > most:
            raise InputError(f"{name}: {len(angles)} angles of one kind, at most {most} are read; export it coarser")
        if np.any(np.diff(angles) < _FINEST_DEG):
            raise InputError(f"{name}: its angles must rise, by {_FINEST_DEG:g} degrees or more; export it again")


def not_below_zero(
    candela: Float[np.ndarray, "c g"], name: str, quantity: str = "intensities", unit: str = " cd"
) -> tuple[Float[np.ndarray, "c g"], tuple[str, ...]]:
    """Intensities, or another ``quantity``, with noise below 0 set to 0, and a warning that says so.

    Raises :class:`InputError` if one is below 0 by more than a hundredth of the largest, or none is above 0.
    """
    least = float(candela.min())
    largest = float(candela.max())
    if not (SMALLEST < largest < HUGE and least >= -_MOST_BELOW_ZERO * largest):
        raise InputError(
            f"{name}: {quantity} from {least:g} to {largest:g}{unit} must lie within 0 and {HUGE:g}{unit}, not all 0 "
            f"(noise down to -{_MOST_BELOW_ZERO:g} of the largest is taken as 0); export it again"
        )
    below = candela < 0.0
    if not below.any():
        return candela, ()
    warning = (
        f"{np.count_nonzero(below)} of {candela.size} {quantity} are below 0, the least {least:.3g}{unit} "
        f"({-least / largest:.2g} of the largest): taken as 0"
    )
    return np.maximum(candela, 0.0), (warning,)


def _whole_turn(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"], name: str
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """Half-planes from 0 to 360: mirrored at 90, 180 or 270 if the file ends there, and closed."""
    if len(c_deg) == 1:
        return np.zeros(1), candela
    if c_deg.tolist() == [0.0, 360.0]:  # one half-plane, twice
        return np.zeros(1), candela[:1]
    ends = (float(c_deg[0]), float(c_deg[-1]))
    for first, last in ((0.0, 90.0), (90.0, 270.0), (0.0, 180.0)):
        if (c_deg[0], c_deg[-1]) == (first, last):
            c_deg, candela = _mirrored_at(c_deg, candela, last)
    if c_deg[0] == 0.0 and c_deg[-1] == 360.0:
        return c_deg, candela
    gap = float(c_deg[0] + 360.0 - c_deg[-1])
    widest = float(np.diff(c_deg).max()) + 1e-6
    if (gap > widest or len(c_deg) < 3) and (gap >= _WIDEST_GAP or c_deg[0] > 0.0):
        raise InputError(f"{name}: C angles from {ends[0]:g} to {ends[1]:g}: from 0 to 0, 90, 180 or 360")
    return _closed(c_deg, candela)


def _mirrored_at(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"], edge: float
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """The planes and their images in the plane ``edge``, by angles within 0 and 360, without duplicates."""
    angles = np.concatenate([c_deg, (2.0 * edge - c_deg) % 360.0])
    if edge == 180.0:
        angles[len(c_deg)] = 360.0  # the image of C 0 closes the turn
    distinct, rows = np.unique(np.round(angles, 9), return_index=True)
    return distinct, np.concatenate([candela, candela])[rows]


def _closed(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"]
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """The planes completed at 0 and 360, interpolated between the last and the first if missing."""
    if c_deg[0] == 0.0:
        return np.append(c_deg, 360.0), np.concatenate([candela, candela[:1]])
    if c_deg[-1] == 360.0:
        return np.append(0.0, c_deg), np.concatenate([candela[-1:], candela])
    share = (360.0 - c_deg[-1]) / (c_deg[0] + 360.0 - c_deg[-1])
    seam = (1.0 - share) * candela[-1:] + share * candela[:1]
    return np.concatenate([[0.0], c_deg, [360.0]]), np.concatenate([seam, candela, seam])


# Size of the converted table.
_MOST_PLANES = 720
_MOST_GAMMAS = 721
_FINEST_STEP_DEG = 0.05
_LEAST_STEPS = 72  # from the axis to the outermost light: where a file ends amid its light, the edge is one step wide
_FINER = 4.0  # steps of the table for one of the file
_MOST_CHANGED = 0.02  # of the flux; beyond, the file has structure that no table of this size holds

Kind = Literal["A", "B"]
V = Float[np.ndarray, " v"]  # angles in degrees
H = Float[np.ndarray, " h"]


def converted(kind: Kind, v_deg: V, h_deg: H, candela: Float[np.ndarray, "h v"], name: str) -> tuple[CandelaTable, str]:
    """Intensity over C and gamma, and a note on the conversion's errors. ``name`` is the file in errors.

    A range of angles that begins at 0 is mirrored there (LM-63: laterally symmetric); outside its range the file has no
    light. Raises :class:`InputError` for angles beyond -90 to 90 degrees.
    """
    require_angles(h_deg, v_deg, name)
    for label, angles in (("V", v_deg), ("H", h_deg)):
        if len(angles) < 2:
            raise InputError(f"{name}: one {label} angle; a type {kind} file needs two; export it again, or as type C")
        if np.abs(angles).max() > 90.0:
            raise InputError(f"{name}: type {kind}: its {label} angles must rise within -90 to 90; export it again")
    v_deg, candela = _both_sides(v_deg, candela)
    h_deg, turned = _both_sides(h_deg, candela.T)
    candela = turned.T
    flux = _flux(kind, v_deg, h_deg, candela)
    step = float(min(np.diff(v_deg).min(), np.diff(h_deg).min())) / _FINER
    table = _on_half_planes(kind, v_deg, h_deg, candela, step)
    error = table.flux() / flux - 1.0 if flux > 0.0 else np.inf
    if not abs(error) < _MOST_CHANGED:
        raise InputError(f"{name}: type {kind}: its flux as type C differs by {error:.1%}; export it as type C")
    inner = slice(1, -1)  # at the outermost angles the table may end a step inside, or outside, of the file
    worst = np.abs(_read_at(kind, v_deg[inner], h_deg[inner], table) - candela[inner, inner]).max(initial=0.0)
    return table, (
        f"photometric type {kind} converted to C and gamma, V = H = 0 to gamma = 0: its flux changes by {error:+.1g}, "
        f"no intensity by more than {worst / candela.max():.1g} of the largest"
    )


def _both_sides(
    angles: Float[np.ndarray, " k"], rows: Float[np.ndarray, "r k"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "r m"]]:
    """Angles and columns with their mirror images about 0 if the file begins there."""
    if angles[0] != 0.0:
        return angles, rows
    return np.concatenate([-angles[:0:-1], angles]), np.concatenate([rows[:, :0:-1], rows], axis=1)


def _flux(kind: Kind, v_deg: V, h_deg: H, candela: Float[np.ndarray, "h v"]) -> float:
    """Integral of the intensities, bilinear in V and H: exact along the latitude, trapezoids along the other angle."""
    latitude, longitude, rows = (h_deg, v_deg, candela.T) if kind == "B" else (v_deg, h_deg, candela)
    return float(np.trapezoid(flux_up_to(np.deg2rad(latitude + 90.0), rows)[:, -1], np.deg2rad(longitude)))


def _on_half_planes(kind: Kind, v_deg: V, h_deg: H, candela: Float[np.ndarray, "h v"], step_deg: float) -> CandelaTable:
    """Table with ``step_deg`` in gamma, as far as the file has light, and in C at its end; bilinear in V and H."""
    from scipy.interpolate import RegularGridInterpolator  # for the few files that are not of type C

    corner = np.cos(np.deg2rad(np.abs(v_deg).max())) * np.cos(np.deg2rad(np.abs(h_deg).max()))
    reach = float(np.rad2deg(np.arccos(np.clip(corner, 0.0, 1.0))))
    step = max(min(step_deg, reach / _LEAST_STEPS), _FINEST_STEP_DEG)
    gamma_deg = np.linspace(0.0, reach, min(max(int(np.ceil(reach / step)), 2), _MOST_GAMMAS - 1) + 1)
    around = 360.0 * np.sin(np.deg2rad(reach)) / step
    c_deg = np.linspace(0.0, 360.0, int(np.clip(4 * np.ceil(around / 4.0), 8, _MOST_PLANES)) + 1)
    c = np.deg2rad(c_deg)[:, None]
    gamma = np.deg2rad(gamma_deg)[None]
    i = np.sin(gamma) * np.cos(c)
    j = np.sin(gamma) * np.sin(c)
    k = np.cos(gamma) * np.ones_like(c)
    if kind == "B":
        v = np.arctan2(i, k)
        h = -np.arcsin(np.clip(j, -1.0, 1.0))
    else:
        v = np.arcsin(np.clip(i, -1.0, 1.0))
        h = -np.arctan2(j, k)
    at = RegularGridInterpolator((h_deg, v_deg), candela, bounds_error=False, fill_value=0.0)
    places = np.stack([np.rad2deg(h), np.rad2deg(v)], axis=-1)
    return CandelaTable(c_deg, gamma_deg, at(np.round(places, 9)))  # so that those on an edge are within


def _read_at(kind: Kind, v_deg: V, h_deg: H, table: CandelaTable) -> Float[np.ndarray, "h v"]:
    from scipy.interpolate import RegularGridInterpolator

    v = np.deg2rad(v_deg)[None]
    h = np.deg2rad(h_deg)[:, None]
    if kind == "B":
        i = np.cos(h) * np.sin(v)
        j = -np.sin(h) * np.ones_like(v)
        k = np.cos(h) * np.cos(v)
    else:
        i = np.sin(v) * np.ones_like(h)
        j = -np.cos(v) * np.sin(h)
        k = np.cos(v) * np.cos(h)
    c_deg = np.rad2deg(np.arctan2(j, i)) % 360.0
    gamma_deg = np.minimum(np.rad2deg(np.arctan2(np.hypot(i, j), k)), table.gamma_deg[-1])
    return np.asarray(
        RegularGridInterpolator((table.c_deg, table.gamma_deg), table.values)(np.stack([c_deg, gamma_deg], axis=-1))
    )
