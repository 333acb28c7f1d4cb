"""Record of a photometric file of either format: candela over C and gamma, lamp lumens, luminous opening."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.intensity import TabulatedIntensity

MOST_NUMBERS = 10**6  # of intensities: 721 x 361 is the finest seen; more comes from a damaged header
HUGE = 1e12  # above any real candela or lumen; squares of sums stay finite


@dataclass(frozen=True, eq=False)
class PhotometricFile:
    """Far field. ``intensity`` in cd for ``lamp_lumens``; None where the file is absolute and states no lamp flux.

    ``stated_lumens`` is the luminaire's flux by the file itself (EULUMDAT's light output ratio), None where it states
    none. ``diameter_mm``: of the luminous opening, where it is round; 0 elsewhere.
    """

    intensity: TabulatedIntensity
    lamp_lumens: float | None = None
    stated_lumens: float | None = None
    title: str = ""
    diameter_mm: float = 0.0
    watts: float = 0.0
    format: str = ""


@dataclass(frozen=True)
class PhotometricFormat:
    """A format: ``matches`` a text by its content, ``decode`` a text and its file's name, ``encode`` a far field."""

    suffix: str
    matches: Callable[[str], bool]
    decode: Callable[[str, str], PhotometricFile]
    encode: Callable[[PhotometricFile], str]


def tabulated(
    c_deg: Float[np.ndarray, " c"], gamma_deg: Float[np.ndarray, " g"], candela: Float[np.ndarray, "c g"], name: str
) -> TabulatedIntensity:
    """Make the table, its mirror images added where the file leaves them out; ``name`` is the file in errors."""
    for label, angles, most in (("C", c_deg, 360.0), ("gamma", gamma_deg, 180.0)):
        if np.any(np.diff(angles) <= 0.0) or angles[0] < 0.0 or angles[-1] > most:
            raise InputError(f"{name}: its {label} angles must rise within 0 to {most:g}; export it again")
    if len(gamma_deg) < 2:
        raise InputError(f"{name}: one gamma angle only; a far field needs two or more")
    if not (candela.min() >= 0.0 and 0.0 < candela.max() < HUGE):
        raise InputError(f"{name}: intensities must lie within 0 and {HUGE:g} cd, not all 0; export it again")
    c_deg, candela = _whole_turn(c_deg, candela, name)
    return TabulatedIntensity(c_deg, gamma_deg, candela)


def _whole_turn(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"], name: str
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    """Half-planes from 0 to 360: mirrored at 90 and 180 where the file ends there, closed where it ends before 360."""
    if len(c_deg) == 1:
        return np.zeros(1), candela
    if c_deg[0] == 90.0 and c_deg[-1] == 270.0:  # symmetric to the plane C 90 - C 270
        c_deg, candela = _mirrored_at(c_deg, candela, 270.0)
        below = c_deg >= 360.0
        c_deg = np.concatenate([c_deg[below] - 360.0, c_deg[~below]])
        candela = np.concatenate([candela[below], candela[~below]])
        return np.append(c_deg, 360.0), np.concatenate([candela, candela[:1]])
    for edge in (90.0, 180.0):
        if c_deg[0] == 0.0 and c_deg[-1] == edge:
            c_deg, candela = _mirrored_at(c_deg, candela, edge)
    if c_deg[0] == 0.0 and c_deg[-1] < 360.0 and 360.0 - c_deg[-1] < 90.0:
        return np.append(c_deg, 360.0), np.concatenate([candela, candela[:1]])
    if c_deg[0] != 0.0 or c_deg[-1] != 360.0:
        raise InputError(f"{name}: C angles from {c_deg[0]:g} to {c_deg[-1]:g}: from 0 to 0, 90, 180 or 360")
    return c_deg, candela


def _mirrored_at(
    c_deg: Float[np.ndarray, " c"], candela: Float[np.ndarray, "c g"], edge: float
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, "d g"]]:
    mirror = slice(-2, None, -1) if edge != 270.0 else slice(-2, 0, -1)
    return np.concatenate([c_deg, 2.0 * edge - c_deg[mirror]]), np.concatenate([candela, candela[mirror]])
