"""Table of a whole turn from the half-planes of a file: mirror images added, the turn closed, noise below 0 clipped."""

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.record import HUGE, MOST_GAMMAS, MOST_PLANES, SMALLEST

# Share of the largest intensity. Goniophotometers leave some 0.1 % of it below 0 where stray light is taken off (-0.02
# cd in files of 10 cd and more); ten times that is no noise but a damaged number.
_MOST_BELOW_ZERO = 0.01
_FINEST_DEG = 1e-4  # files state angles to 0.001 degrees; flux over less is rounding
_SAME_PLANE = 1e-3  # of the largest intensity, by which C 360 may differ from C 0, the same half-plane
_WIDEST_GAP = 90.0  # degrees that a file may leave open before C 360; wider, it lacks half-planes


def tabulated(
    c_deg: Float[np.ndarray, " c"], gamma_deg: Float[np.ndarray, " g"], candela: Float[np.ndarray, "c g"], name: str
) -> tuple[TabulatedIntensity, tuple[str, ...]]:
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
        warnings = (*warnings, f"its only half-plane is C {c_deg[0]:g}: taken as that of light of revolution")
    candela, seam = _one_seam(c_deg, candela)
    if seam > _SAME_PLANE:
        line = f"its half-planes C 0 and C 360, which are one, differ by {seam:.2g} of the largest: their mean is taken"
        warnings = (*warnings, line)
    c_deg, candela = _whole_turn(c_deg, candela, name)
    table = TabulatedIntensity(c_deg, gamma_deg, candela)
    if not table.flux() > SMALLEST:
        raise InputError(f"{name}: its intensities hold no flux, gamma {gamma_deg[0]:g} to {gamma_deg[-1]:g}")
    return table, warnings


def _one_seam(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"]
) -> tuple[Float[np.ndarray, "c g"], float]:
    """Intensities with the mean of C 0 and C 360 in both, and their largest difference, of the largest intensity."""
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


def not_below_zero(candela: Float[np.ndarray, "c g"], name: str) -> tuple[Float[np.ndarray, "c g"], tuple[str, ...]]:
    """Intensities with the noise below 0 taken as 0, and the warning that says so.

    Raises :class:`InputError` where one is below 0 by more than a hundredth of the largest, or none is above 0.
    """
    least, largest = float(candela.min()), float(candela.max())
    if not (SMALLEST < largest < HUGE and least >= -_MOST_BELOW_ZERO * largest):
        raise InputError(
            f"{name}: intensities from {least:g} to {largest:g} cd must lie within 0 and {HUGE:g} cd, not all 0 "
            f"(noise down to -{_MOST_BELOW_ZERO:g} of the largest is taken as 0); export it again"
        )
    below = candela < 0.0
    if not below.any():
        return candela, ()
    warning = (
        f"{np.count_nonzero(below)} of {candela.size} intensities are below 0, the least {least:.3g} cd "
        f"({-least / largest:.2g} of the largest): taken as 0"
    )
    return np.maximum(candela, 0.0), (warning,)


def _whole_turn(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"], name: str
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """Half-planes from 0 to 360: mirrored at 90, 180 or 270 where the file ends there, and closed."""
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
    if gap >= _WIDEST_GAP or (c_deg[0] > 0.0 and gap > np.diff(c_deg).max() + 1e-6):
        raise InputError(f"{name}: C angles from {ends[0]:g} to {ends[1]:g}: from 0 to 0, 90, 180 or 360")
    return _closed(c_deg, candela)


def _mirrored_at(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"], edge: float
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """The planes and their images about the plane ``edge``, by angles within 0 and 360, each once."""
    angles = np.concatenate([c_deg, (2.0 * edge - c_deg) % 360.0])
    if edge == 180.0:
        angles[len(c_deg)] = 360.0  # the image of C 0 closes the turn
    found, rows = np.unique(np.round(angles, 9), return_index=True)
    return found, np.concatenate([candela, candela])[rows]


def _closed(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"]
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """The planes with those at 0 and 360, interpolated between the last and the first where the file has none there."""
    if c_deg[0] == 0.0:
        return np.append(c_deg, 360.0), np.concatenate([candela, candela[:1]])
    if c_deg[-1] == 360.0:
        return np.append(0.0, c_deg), np.concatenate([candela[-1:], candela])
    share = (360.0 - c_deg[-1]) / (c_deg[0] + 360.0 - c_deg[-1])
    seam = (1.0 - share) * candela[-1:] + share * candela[:1]
    return np.concatenate([[0.0], c_deg, [360.0]]), np.concatenate([seam, candela, seam])
