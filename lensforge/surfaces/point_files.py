"""Files of points: text in rows, of which some may belong to other faces, and PLY.

A table may have the name of a face in each row, under ``surface`` or ``feature`` as the tables for the shop have it,
and the measured coordinates beside the nominal ones: the measured ones are read.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.results.files import MIB, read_file
from lensforge.results.table_names import DEGREES, MILLIMETRES, Column, Names
from lensforge.results.text_dialect import shown
from lensforge.results.text_table import TextTable

LEAST_POINTS = 100
_MOST_BYTES = 128 * MIB  # four million points, which take 1 GiB while they are read; scanners measure a million
_FURTHEST_MM = 1e6  # a machine's own zero may be metres away
Coordinates = Literal["cartesian", "polar"]
_COLUMNS = {
    "cartesian": tuple(Column((axis,), MILLIMETRES) for axis in "xyz"),
    "polar": (
        Column(("polar", "theta", "angle from the axis"), DEGREES),
        Column(("azimuth", "phi"), DEGREES),
        Column(("distance", "r", "radius"), MILLIMETRES),
    ),
}
_ACTUAL = ("actual", "act", "measured", "meas", "mess", "ist")  # as programs of measuring machines have it
_MEASURED = tuple(
    Column(tuple(name for word in _ACTUAL for name in (f"{axis}_{word}", f"{word}_{axis}")), MILLIMETRES)
    for axis in "xyz"
)
_LABELS = ("surface", "feature", "face", "element")
_MOST_SHOWN = 6  # names in a message


@dataclass(frozen=True)
class FaceOfPart:
    """The face ``name`` of a part with ``faces``, which selects the rows of a table."""

    name: str
    faces: Sequence[str]


def read_cloud(
    path: Path,
    missing: str = "give the file of the measured points",
    coordinates: Coordinates = "cartesian",
    of: FaceOfPart | None = None,
) -> Float[np.ndarray, "n 3"]:
    """Read points from a file: PLY, or text with x, y, z (mm) first in each line, or in columns of these names.

    Polar ``coordinates``: angle from the axis, azimuth (degrees) and distance (mm). Units may stand with the names.
    Lines before the first point, a count of points and further columns are skipped; ``of``: so are rows of other faces
    of the part. Raises :class:`InputError`, with a line.
    """
    content = read_file(path, missing=missing, most_bytes=_MOST_BYTES)
    if content.startswith(_PLY_MARK):
        cloud = _in_ply(content, path)
        _require_near(cloud, path)
    else:
        table = TextTable.of(content, str(path), counted=True)
        cloud = _in_text(table, coordinates, of)
    if len(cloud) < LEAST_POINTS:
        raise InputError(f"{path}: {len(cloud)} points, must be at least {LEAST_POINTS}")
    return cloud


def _in_text(table: TextTable, coordinates: Coordinates, of: FaceOfPart | None) -> Float[np.ndarray, "n 3"]:
    wanted = _COLUMNS[coordinates]
    either = (*wanted, *_MEASURED) if coordinates == "cartesian" else wanted
    names = table.names(either, further=True)
    label = None
    if names is None:
        _require_uncounted(table, wanted)
    else:
        if coordinates == "cartesian" and _has(names, _MEASURED):
            wanted = _MEASURED
        label = None if of is None else _label(table, names, of)
        table = table if of is None or label is None else _rows_of(table, names.cells[label], label, of)
    cloud = table.columns(wanted, further=True, read=() if label is None else (label,))
    furthest = np.abs(cloud).max(axis=1)
    row = int(furthest.argmax())
    if furthest[row] > _FURTHEST_MM:
        fault = f"a coordinate of {furthest[row]:.4g} mm, must be at most {_FURTHEST_MM:g}; remove it"
        raise table.refuse(row, int(np.abs(cloud[row]).argmax()), fault)
    return cloud


def _has(names: Names, wanted: Sequence[Column]) -> bool:
    """True if each of the columns exists, whatever its unit."""
    return all(any(column.factor_of(cell) is not None for cell in names.cells) for column in wanted)


def _label(table: TextTable, names: Names, of: FaceOfPart) -> int | None:
    """Index of the column that tells the part's faces apart; None if the labels are of points, or of another part."""
    place = next((at for at, cell in enumerate(names.cells) if cell.strip().lower() in _LABELS), None)
    faces = {name.lower() for name in of.faces}
    return place if place is not None and faces & set(_labels(table, place)) else None


def _labels(table: TextTable, place: int) -> list[str]:
    return [row[place].strip().lower() if place < len(row) else "" for row in table.cells]


def _rows_of(table: TextTable, title: str, place: int, of: FaceOfPart) -> TextTable:
    """The rows of one face, by the column ``title`` at ``place``."""
    labels = _labels(table, place)
    rows = [line for line, label in zip(table.rows, labels, strict=True) if label == of.name.lower()]
    if not rows:
        listed = ", ".join(map(shown, list(dict.fromkeys(labels))[:_MOST_SHOWN]))
        fault = f"no row of {title.strip()} {of.name!r}; found {listed}"
        raise InputError(f"{table.name}: {fault}; give the face that was measured")
    return replace(table, rows=rows)


def _require_uncounted(table: TextTable, wanted: Sequence[Column]) -> None:
    """Raise :class:`InputError` if the first of more columns than wanted is a count of the rows."""
    if table.width <= len(wanted):
        return
    first = table.numbers(used=[0], further=True)[:, 0]
    if len(first) > 1 and first[0] in (0.0, 1.0) and bool((np.diff(first) == 1.0).all()):
        heads = ",".join(["number", *(column.title for column in wanted)])
        raise table.refuse(0, 0, f"this column counts the rows; put names above them, such as {heads}")


def _require_near(cloud: Float[np.ndarray, "n 3"], path: Path) -> None:
    if not (np.abs(cloud) <= _FURTHEST_MM).all():  # NaN neither
        row = int(np.argmax(~(np.abs(cloud) <= _FURTHEST_MM).all(axis=1)))
        x, y, z = cloud[row]
        raise InputError(
            f"{path}: point {row + 1} lies at ({x:.4g}, {y:.4g}, {z:.4g}) mm, must be at most {_FURTHEST_MM:g} away; "
            "remove it"
        )


_PLY_MARK = b"ply"
_PLY_END = b"end_header"
_MOST_HEADER_BYTES = 16_384
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_PLY_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def _in_ply(content: bytes, path: Path) -> Float[np.ndarray, "n 3"]:
    """Points (mm) of the vertices in a PLY file, by the properties that its header states."""
    end = content.find(_PLY_END, 0, _MOST_HEADER_BYTES)
    lines = [line.split() for line in content[: max(end, 0)].decode("latin-1").splitlines()]
    layout = next((line[1] for line in lines if len(line) > 1 and line[0] == "format"), "")
    elements = [line for line in lines if line and line[0] in ("element", "property")]
    count, properties = _ply_vertices(elements)
    if end < 0 or layout not in _PLY_ORDER or not {"x", "y", "z"} <= properties.keys():
        raise InputError(
            f"{path}: its PLY header must state a format, the element vertex first, and its properties x, y, z, each a "
            "number; export it again, or as text"
        )
    body = content[content.find(b"\n", end) + 1 :]
    if layout == "ascii":
        return _ply_text(body, count, list(properties), path)
    types = np.dtype([(name, _PLY_ORDER[layout] + kind) for name, kind in properties.items()])
    if len(body) < count * types.itemsize:
        raise InputError(f"{path}: ends before the last of its {count} vertices; export it again")
    rows = np.frombuffer(body, types, count)
    return np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _ply_vertices(elements: Sequence[Sequence[str]]) -> tuple[int, dict[str, str]]:
    """Number of vertices, and the types of their properties; None unless they come first and are plain numbers."""
    if not elements or elements[0][:2] != ["element", "vertex"] or not elements[0][-1].isdecimal():
        return 0, {}
    properties: dict[str, str] = {}
    for line in elements[1:]:
        if line[0] == "element":
            break
        if len(line) != 3 or line[1] not in _PLY_TYPES or line[2] in properties:
            return 0, {}
        properties[line[2]] = _PLY_TYPES[line[1]]
    return int(elements[0][-1][:9]), properties


def _ply_text(body: bytes, count: int, names: Sequence[str], path: Path) -> Float[np.ndarray, "n 3"]:
    lines = body.decode("latin-1").splitlines()[:count]
    if len(lines) < count or not count:
        raise InputError(f"{path}: {len(lines)} lines of vertices, its header states {count}; export it again")
    try:
        return np.loadtxt(lines, comments=None, ndmin=2, usecols=[names.index(axis) for axis in "xyz"])
    except ValueError as error:
        raise InputError(f"{path}: its vertices are no rows of numbers ({' '.join(str(error).split())[:80]})") from None
