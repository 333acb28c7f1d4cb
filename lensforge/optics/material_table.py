"""Materials from a table (.csv, .txt): wavelength, index, and how much the material absorbs.

The latter as internal transmittance over 1 mm, or over the thickness that its name states ("T (10 mm)"), as
absorption (1/mm, 1/cm or 1/m), or as extinction coefficient k. Without names the columns are wavelength (nm), index
and, if there is a third, transmittance over 1 mm. Index and absorption are linear between the rows.
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.material import HUGE, IndexTable, Material, absorption_of, absorption_per_mm
from lensforge.results.files import MIB
from lensforge.results.table_names import NANOMETRES, SHARE, Column, Names
from lensforge.results.text_dialect import shown
from lensforge.results.text_table import TextTable

_MOST_TABLE_BYTES = 4 * MIB  # ten thousand rows, the most of a spec, have 0.3 MiB
_LEAST_NM = 100.0  # below that are um: no light here is shorter
_THICKNESS = re.compile(r"(?:over|of|for|at)?[\W_]*([\d.]+)\W*(mm|cm)(?![^\W_])")
_MM = {"mm": 1.0, "cm": 10.0}
_TRANSMITTANCE = 2  # its place in these columns
_COLUMNS = (
    Column(("wavelength", "lambda", "λ", "wl", "nm", "wellenlänge"), NANOMETRES),
    Column(("index", "n", "refractive index", "index of refraction", "brechzahl", "brechungsindex")),
    Column(("transmittance", "t", "tau", "tau_i", "internal transmittance"), SHARE, needed=False, beside=_THICKNESS),
    Column(
        ("absorption", "absorption coefficient", "alpha", "α"),
        {"per_mm": 1.0, "per_cm": 0.1, "per_m": 1e-3},
        needed=False,
        by_place=False,
    ),
    Column(("k", "kappa", "extinction coefficient"), needed=False, by_place=False),
)


def read_material_table(path: Path, name: str) -> Material:
    """Read the table at ``path``; ``name``: what the material is called. Raises :class:`InputError`, one line."""
    rows = TextTable.read(path, missing="give a table of the index", most_bytes=_MOST_TABLE_BYTES)
    table = rows.columns(_COLUMNS)
    if len(table) < 2:
        raise InputError(f"{path}: must be two rows at least of wavelength (nm), index and, if known, transmittance")
    order = np.argsort(table[:, 0])
    waves = table[order, 0]
    per_mm = _per_mm(table, rows)
    if waves[-1] < _LEAST_NM or (np.diff(waves) <= 0.0).any():
        raise InputError(f"{path}: wavelengths must be in nm, each once; they go from {waves[0]:g} to {waves[-1]:g}")
    index = IndexTable(tuple(waves.tolist()), tuple(table[order, 1].tolist()))
    absorption = [] if per_mm is None else np.column_stack([waves, per_mm[order]]).tolist()
    return Material(name, index, (float(waves[0]), float(waves[-1])), path.name, None, absorption_of(absorption))


def _per_mm(table: Float[np.ndarray, "n k"], rows: TextTable) -> Float[np.ndarray, " n"] | None:
    """Absorption (1/mm) by the one column that tells it; None without such a column."""
    waves, _, transmittance, absorption, extinction = table.T
    given = [column for column in (transmittance, absorption, extinction) if not np.isnan(column).any()]
    if len(given) > 1:
        raise InputError(f"{rows.name}: gives absorption in {len(given)} columns; leave out all but one")
    if not given:
        return None
    if given[0] is transmittance:
        if not ((transmittance > 0.0) & (transmittance <= 1.0)).all():
            raise InputError(f"{rows.name}: an internal transmittance must be above 0 and at most 1{rows.advice}")
        per_mm: Float[np.ndarray, " n"] = -np.log(transmittance) / _thickness_mm(rows.names(_COLUMNS), rows.name) + 0.0
    else:
        per_mm = absorption if given[0] is absorption else absorption_per_mm(extinction, waves)
    if not ((per_mm >= 0.0) & (per_mm < HUGE)).all():
        raise InputError(f"{rows.name}: its absorption must be 0 or above{rows.advice}")
    return per_mm


def _thickness_mm(names: Names | None, where: str) -> float:
    """The thickness that the name of the transmittance states; 1 mm where it states none."""
    if names is None:
        return 1.0
    place, _ = names.places(_COLUMNS)[_TRANSMITTANCE]
    stated = _THICKNESS.search(names.cells[place].lower())
    if stated is None:
        return 1.0
    try:
        thickness = float(stated[1]) * _MM[stated[2]]
    except ValueError:
        thickness = 0.0
    if not thickness > 0.0:
        raise InputError(f"{where}: {shown(names.cells[place])}: its thickness must be above 0 mm")
    return thickness
