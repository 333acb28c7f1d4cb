"""Radiance tables as NumPy archives (`.npz`): five arrays, named and shaped as in :class:`RadianceTable`."""

import zlib
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.sources.radiance_table import RadianceTable

_NAMES = ("x_mm", "y_mm", "c_deg", "gamma_deg", "radiance")
_LARGEST = 2**28  # bytes unpacked, some 30 million nodes; a small archive may claim anything


def read_radiance(path: Path) -> RadianceTable:
    """Read ``path``. Raises :class:`InputError`, one line, if it is missing, damaged, or no table of radiances."""
    arrays = _arrays(path)
    problem = _problem(arrays)
    if problem:
        raise InputError(f"source.file = {path}: {problem}")
    table = RadianceTable(**arrays)
    if not 0.0 < table.flux() < np.inf:
        raise InputError(
            f"source.file = {path}: its flux is {table.flux():g} W: radiances must not be all dark, or huge"
        )
    return table


def write_radiance(path: Path, table: RadianceTable) -> None:
    """Write ``table`` so that :func:`read_radiance` finds the same numbers."""
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **{name: getattr(table, name) for name in _NAMES})


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with ZipFile(path) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > _LARGEST:
            raise InputError(f"source.file = {path}: {unpacked} bytes unpacked; at most {_LARGEST}: use fewer nodes")
        with np.load(path, allow_pickle=False) as archive:
            missing = [name for name in _NAMES if name not in archive]
            if missing:
                raise InputError(f"source.file = {path}: no array {missing[0]!r}; it needs {', '.join(_NAMES)}")
            return {name: np.asarray(archive[name]).astype(np.float64, casting="same_kind") for name in _NAMES}
    except FileNotFoundError:
        raise InputError(f"source.file = {path}: no such file") from None
    except (OSError, ValueError, TypeError, EOFError, BadZipFile, zlib.error, NotImplementedError) as error:
        problem = " ".join(str(error).split())[:160]
        raise InputError(f"source.file = {path}: not readable as a NumPy archive ({problem})") from None


def _problem(arrays: dict[str, np.ndarray]) -> str:
    """What is wrong with ``arrays``, in words; empty if nothing is."""
    x, y, c, gamma, radiance = arrays.values()
    for name, values in list(arrays.items())[:4]:
        revolution = name == "c_deg" and values.shape == (1,)
        if values.ndim != 1 or not np.isfinite(values).all() or (len(values) < 2 and not revolution):
            return f"{name} must be a list of two finite numbers or more"
        if not (np.diff(values) > 0.0).all():
            return f"{name} must rise from each number to the next"
    if gamma[0] < 0.0 or gamma[-1] > 90.0:
        return f"gamma_deg = {gamma[0]:g} to {gamma[-1]:g}: within 0 to 90"
    if c[0] != 0.0 or (len(c) > 1 and c[-1] != 360.0):
        return "c_deg must run from 0 to 360, both included, or be the single number 0"
    wanted = (len(y) - 1, len(x) - 1, len(c), len(gamma))
    if radiance.shape != wanted:
        return f"radiance has the shape {radiance.shape}; cells in y and x, azimuths, polar angles make {wanted}"
    if not np.isfinite(radiance).all() or radiance.min() < 0.0:
        return "radiances must be finite, none below 0"
    if len(c) > 1 and not np.array_equal(radiance[:, :, 0], radiance[:, :, -1]):
        return "the radiances at c_deg = 360 must be those at 0"
    return ""
