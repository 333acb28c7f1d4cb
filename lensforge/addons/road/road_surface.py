"""Surfaces of roads: the light that one sends to a driver, as reduced luminance coefficients, the r-tables of the CIE.

A point under a lamp of height h and intensity I has the luminance L = I r(beta, tan gamma) / h^2 (CIE 140, 2.1): gamma
is the angle of incidence, beta that between the planes of observation and incidence, 0 where the lamp is straight ahead
beyond the point; the eye looks down by 1 degree. Between the entries r is bilinear; beyond the table it is 0.

The shipped tables are R1 to R4 of CIE 30.2 (1982), and C1 and C2 of CIE 66 (1984), all of CIE 144:2001. They are taken
from the tables of a framework for Radiance of TU Berlin (J. Winter, S. Buschmann, R. Franke), of which a second copy
(jacho35/protectionpro) has R2 as well, and has compared C2 with table 2 of CIE 140:2000: three entries are taken from
there. The tables of the program DIALux (neo-era/webdialux-cs) are the same in all but 12 of 1980 entries of R1 to R4
and C2. Of these one is taken from there, 2.0 of R3 at tan gamma 10, beta 20, where the other does not fall; elsewhere
this copy's numbers lie between their neighbours at least as well, or are those of CIE 140. Of C1 there is one copy.
Their own specular factors S1 are the published ones to all digits; their integrals Q0 are 1 to 3 % above the nominal
ones, as bilinear ones of a convex function are. W4, a wet surface of CIE 47 (1979), is of the same tables alone: its
integral is 2.6 % above the Q0 of 0.247 in van Bommel, Road Lighting (2015), table 12.3, its S1 of 10.8 between the
limits of its class there, 9.8 and 12. W3 has 17 columns in the place of 20 in these tables, without their angles, of
which several choices are as smooth, and a wrong number; N1 to N4, W1 and W2 were not at hand.
"""

import re
from dataclasses import dataclass, replace
from functools import cache
from math import nan
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.addons.road.road_section import LEAST_Q0, MOST_Q0, STANDARD_SURFACES
from lensforge.errors import InputError
from lensforge.results.files import MIB
from lensforge.results.table_names import header_cells
from lensforge.results.text_dialect import shown
from lensforge.results.text_table import TextTable

_FOLDER = Path(__file__).with_name("road_surfaces")
_SCALE = 1e-4  # of the numbers in a table
_MOST_BYTES = 1 * MIB
# Luminance coefficients in any unit: a table between these can be scaled.
_LEAST_BELOW = 1e-6
_MOST = 1e6
_LEAST_STEP_DEG = 0.01
_LEAST_STEP_TAN = 1e-3
_MOST_TAN = 100.0  # lamps of a road count up to tan 12
_S1_TAN = 2.0
_GAMMA_ITSELF = re.compile(r"\W*(gamma|γ)(?!\w)", re.IGNORECASE)  # in the corner of a table
# The field of integration of Q0, in heights of the lamp: towards the eye, away from it, and to either side (CIE 144).
_NEAR = 4.0
_FAR = 12.0
_SIDE = 3.0
_CELLS = 200


@dataclass(frozen=True, eq=False)
class RoadSurface:
    """Reduced luminance coefficients ``r`` (cd/m^2 per lx) at ``tan_gamma`` and ``beta_deg``; 0 elsewhere.

    ``q0``: average luminance coefficient: the nominal one of a class of the CIE, of another table its integral, of one
    that ends within the field of integration that over the part which it has.
    """

    name: str
    tan_gamma: Float[np.ndarray, " g"]
    beta_deg: Float[np.ndarray, " b"]
    r: Float[np.ndarray, "g b"]
    q0: float

    @staticmethod
    def of(name: str, file: Path | None = None, q0: float | None = None) -> "RoadSurface":
        """The surface of the class ``name``, such as "R3", or of a CSV ``file``, scaled to an average ``q0``.

        Raises :class:`InputError` for a file without such a table, and for an implausible one, unless it is scaled.
        """
        surface = _standard(name) if file is None else read_surface(file)
        if q0 is not None:
            return replace(surface, r=surface.r * (q0 / surface.q0), q0=q0)
        if not LEAST_Q0 <= surface.q0 <= MOST_Q0:
            raise InputError(
                f"{file}: its average luminance coefficient Q0 is {surface.q0:.2g}, of a road it is from "
                f"{LEAST_Q0:g} to {MOST_Q0:g}: give r (cd/m^2 per lx) times 10^4, or surface_q0, to which the table is "
                "scaled"
            )
        return surface

    @property
    def s1(self) -> float | None:
        """Specular factor S1: r at beta = 0, tan gamma = 2 over r below the lamp; None for a shorter table."""
        if self.tan_gamma[-1] < _S1_TAN:
            return None
        return float(self.reading(np.zeros(1), np.array([_S1_TAN])).item() / self.r[0, 0])

    def reading(self, beta_deg: Float[np.ndarray, "*n"], tan_gamma: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Bilinear r (cd/m^2 per lx) at angles from 0 to 180 degrees and tangents; 0 beyond the last of these."""
        low, more = _place(tan_gamma, self.tan_gamma)
        left, right = _place(beta_deg, self.beta_deg)
        nearer = (1.0 - right) * self.r[low, left] + right * self.r[low, left + 1]
        farther = (1.0 - right) * self.r[low + 1, left] + right * self.r[low + 1, left + 1]
        return ((1.0 - more) * nearer + more * farther) * (tan_gamma <= self.tan_gamma[-1])

    def integrated_q0(self) -> float:
        """Average luminance coefficient: q = r / cos^3(gamma) over the solid angle of the field of integration."""
        x = -_NEAR + (np.arange(_CELLS) + 0.5) * ((_NEAR + _FAR) / _CELLS)
        y = (np.arange(_CELLS) + 0.5) * (_SIDE / _CELLS)
        along, aside = np.meshgrid(x, y)
        away = np.hypot(along, aside)
        seen = self.reading(np.degrees(np.arctan2(aside, along)), away)
        return float(seen.sum() / ((1.0 + away**2) ** -1.5)[away <= self.tan_gamma[-1]].sum())


def _place(
    values: Float[np.ndarray, "*n"], nodes: Float[np.ndarray, " k"]
) -> tuple[np.ndarray, Float[np.ndarray, "*n"]]:
    """Cell of each value, and the position in it from 0 to 1."""
    cell = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, len(nodes) - 2)
    return cell, np.clip((values - nodes[cell]) / (nodes[cell + 1] - nodes[cell]), 0.0, 1.0)


@cache
def _standard(name: str) -> RoadSurface:
    return replace(read_surface(_FOLDER / f"{name}.csv"), name=name, q0=STANDARD_SURFACES[name])


def read_surface(path: Path) -> RoadSurface:
    """Read a table: a row of beta (degrees), then for each tan gamma a row of 10^4 r; blank beyond the table.

    Blanks end a row, and continue in the rows below. Raises :class:`InputError`, one line, for anything else.
    """
    table = TextTable.read(path, missing="give a CSV file, or a class of surface", most_bytes=_MOST_BYTES)
    beta, tan_gamma, r = _grid(table)
    _require_places(beta, tan_gamma, table.name)
    _require_no_gaps(r, tan_gamma, beta, table.name)
    r = np.nan_to_num(r)
    if not (r.min() >= 0.0 and r[0].min() > _LEAST_BELOW and r.max() <= _MOST):
        raise InputError(
            f"{path}: 10^4 r must be from 0 to {_MOST:g}, and above {_LEAST_BELOW:g} at tan gamma = 0; found "
            f"{r.min():g} to {r.max():g}, and {r[0].min():g} there"
        )
    whole = RoadSurface(path.stem, tan_gamma, beta, _SCALE * r, 1.0)
    return replace(whole, q0=whole.integrated_q0())


def _grid(table: TextTable) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, " g"], Float[np.ndarray, "g b"]]:
    """Beta, tan gamma and 10^4 r of a table, NaN where a cell is blank; beta may stand behind a word in a header."""
    rows = table.numbers(blank=nan)
    beta = _beta_of_header(table)
    first = 0
    if beta is None:
        beta = rows[0, 1:]
        rows = rows[1:]
        first = 1
    if len(beta) < 2 or len(rows) < 2:
        raise InputError(
            f"{table.name}: no r-table; give a row of beta from 0 to 180, then rows of tan gamma and 10^4 r"
        )
    blank = np.flatnonzero(np.isnan(rows[:, 0]))
    if len(blank):
        raise table.refuse(first + int(blank[0]), 0, "no tan gamma")
    if np.isnan(beta).any():
        raise InputError(f"{table.name}: a blank in its row of beta; give a beta for each column")
    if rows.shape[1] - 1 > len(beta):
        longer = first + int(np.flatnonzero(~np.isnan(rows[:, len(beta) + 1 :]).all(axis=1))[0])
        raise table.refuse(longer, None, "is longer than the row of beta; give a beta for each column")
    r = np.full((len(rows), len(beta)), nan)
    r[:, : rows.shape[1] - 1] = rows[:, 1:]
    return beta, rows[:, 0], r


def _beta_of_header(table: TextTable) -> Float[np.ndarray, " b"] | None:
    """Numbers after the first word of the last line above the rows, also in a remark; None without any."""
    for line in sorted((*table.header, *table.remarks))[-1:]:
        first, *cells = header_cells(line, table.dialect, table.name) or [""]
        numbers: list[float] = []
        for place, cell in enumerate(cells, start=2):
            try:
                numbers.append(table.dialect.number(cell))
            except ValueError as error:
                if not numbers or line in table.remarks:
                    return None
                raise InputError(f"{table.name}, line {line.number}, column {place}: beta: {error}") from None
        if _GAMMA_ITSELF.match(first):
            fault = f"{shown(first)}: rows must be those of tan gamma, not of gamma; export it so"
            raise InputError(f"{table.name}, line {line.number}: {fault}")
        if numbers and (line in table.header or len(numbers) == table.width - 1):
            return np.array(numbers)
    return None


def _require_places(beta: Float[np.ndarray, " b"], tan_gamma: Float[np.ndarray, " g"], name: str) -> None:
    for nodes, title, step in ((beta, "beta", _LEAST_STEP_DEG), (tan_gamma, "tan gamma", _LEAST_STEP_TAN)):
        if nodes[0] != 0.0 or (np.diff(nodes) < step).any():
            bad = int(np.argmax(np.diff(nodes) < step)) if nodes[0] == 0.0 else 0
            raise InputError(
                f"{name}: {title} must begin with 0 and rise, by {step:g} at least; found {nodes[bad]:g}, "
                f"{nodes[bad + 1]:g}"
            )
    if beta[-1] != 180.0:
        swapped = "; rows and columns are swapped" if tan_gamma[-1] == 180.0 else ""
        raise InputError(
            f"{name}: beta ends at {beta[-1]:g} degrees, must end at 180, where the lamp is behind the eye{swapped}"
        )
    if tan_gamma[-1] > _MOST_TAN:
        raise InputError(f"{name}: tan gamma ends at {tan_gamma[-1]:g}, must be at most {_MOST_TAN:g}")


def _require_no_gaps(
    r: Float[np.ndarray, "g b"], tan_gamma: Float[np.ndarray, " g"], beta: Float[np.ndarray, " b"], name: str
) -> None:
    """Raise :class:`InputError` for a blank with a number farther right or below: it would be read as no light."""
    given = ~np.isnan(r)
    later = np.logical_or.accumulate(given[:, ::-1], axis=1)[:, ::-1]
    below = np.logical_or.accumulate(given[::-1], axis=0)[::-1]
    gaps = np.argwhere(~given & (later | below))
    if len(gaps):
        row, column = gaps[0]
        raise InputError(
            f"{name}: no number at tan gamma = {tan_gamma[row]:g}, beta = {beta[column]:g}, but some beyond it; give it"
        )
