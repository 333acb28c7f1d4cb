"""Names and units of a table's columns: the quantity of a name, and the factor to this program's unit.

A name may have its unit behind it, in brackets or not (``angle_deg``, ``R %``, ``x (in)``, ``lambda / nm``), or in a
row of units below. A unit that is not known, or two that contradict each other, are refused; so is a table without a
name for a column that is needed: a name that is not known is not taken for it.
"""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan, nan

from lensforge.errors import FileWarning, InputError
from lensforge.results.text_dialect import Dialect, Line, shown

Units = Mapping[str, float] | Callable[[str], float]
_MOST_SHOWN = 12  # names in a message

# Units of the columns that several kinds of table have; "" where a name may leave it out.
DEGREES = {"deg": 1.0, "": 1.0, "rad": 57.29577951308232, "mrad": 0.05729577951308232}
NANOMETRES = {"nm": 1.0, "": 1.0, "um": 1e3, "angstrom": 0.1, "a": 0.1, "mm": 1e6, "m": 1e9}
MILLIMETRES = {"mm": 1.0, "": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "nm": 1e-6, "in": 25.4, "ft": 304.8}
SHARE = {"": 1.0, "%": 0.01}

_SPELLINGS = {
    "": ("1", "-", "–", "none", "fraction", "ratio", "dimensionless", "a.u", "arb.u", "arb.units"),
    "deg": ("degree", "degrees"),
    "rad": ("radian", "radians"),
    "mrad": ("milliradian", "milliradians"),
    "nm": ("nanometer", "nanometers", "nanometre", "nanometres"),
    "um": ("micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"),
    "angstrom": ("angstroms", "ångström", "ångströms", "å", "ang"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "cm": ("centimeter", "centimeters", "centimetre", "centimetres"),
    "m": ("meter", "meters", "metre", "metres"),
    "in": ("inch", "inches"),
    "ft": ("foot", "feet"),
    "%": ("percent", "per cent", "pct", "prozent"),
    "w": ("watt", "watts"),
    "lm": ("lumen", "lumens"),
    "sr": ("steradian", "steradians"),
}
_PLAIN = {spelling.replace(" ", ""): unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}
# Quantities and units of other tables: they tell that a line is one of names, where no name of it is wanted.
_OTHER_QUANTITY = re.compile(
    r"\W*(frequency|wavenumber|wavelength|photon|energy|transmi|absorb|absorpt|extinction|reflect|emissi|group.?index|"
    r"(log\d*|ln|nu|sigma|index|lambda|angle|cos|sin|freq|wave)(?![^\W_]))",
    re.IGNORECASE,
)
_OTHER_UNITS = (
    *["hz", "khz", "mhz", "ghz", "thz", "phz", "ev", "mev", "kev", "j", "db", "dbm", "mol", "umol", "lx", "cd"],
    *["per_cm", "per_m", "per_mm", "per_um", "per_nm", "per_sr", "grad", "gon", "mil", "pm", "km", "mw", "uw"],
)
_UNITS = frozenset((*_SPELLINGS, *_OTHER_UNITS)) - {""}
_WORDS_TOO = ("in", "m", "j", "w")  # units that are words of a remark as well
QUARTER_TURN_RAD = 1.58  # rounded up; a polar angle below it may be in radians
_SUM = re.compile(r"\s*[-+−]\s*\d")  # behind a name it is another quantity: the refractivity n-1
_EXPONENT = re.compile(r"\^?-?\d$|^per_(?=.)")
_COMMENT_MARK = re.compile(r"^(?:#+|%\s|//+|!+)\s*")
_LETTERS = str.maketrans({"µ": "u", "μ": "u", "°": "deg", "⁻": "-", "¹": "1", "²": "2", "³": "3"})
_NAME = re.compile(r"[^\s\[(]+(?:\s*(?:\[[^\]]*\]|\([^)]*\)))?")


def _spelt(text: str) -> str:
    return text.translate(_LETTERS).lower().strip()


def plain(text: str) -> str:
    """Letters and digits of a name in lower case, by which names are compared."""
    return "".join(mark for mark in _spelt(text) if mark.isalnum() or mark in "%")


def _unit_in(text: str) -> str:
    """The unit in the text behind a name, or in a cell, without brackets; a leading "/" stays."""
    text = re.sub(r"^\W*\bin\s+", "", text.strip())
    return text.replace("_", " ").strip(" -.:,;()[]{}|'\"") if text not in ("-", "–") else ""


def _canonical(unit: str) -> str:
    """A unit in the spelling of ``Column.units``: ``per_mm`` for 1/mm, mm-1 and per mm."""
    unit = re.sub(r"[\s*^·]+", "", unit)
    inverse = re.fullmatch(r"(?:1/|per|/)\(?(.+?)\)?|(.+?)-1", unit) if unit not in _PLAIN else None
    if inverse is None:
        return _PLAIN.get(unit, unit)
    base = inverse[1] or inverse[2]
    return f"per_{_PLAIN.get(base, base)}"


@dataclass(frozen=True)
class Column:
    """A column that a table may have, by its ``names`` in lower case, the first of which this program writes.

    ``units``: their factors to the first; "" if a name may leave it out; or a function that gives the factor of a unit,
    NaN for one that is refused. ``needed``: False if a table may lack it; ``by_place``: False if only a name identifies
    it. ``is_text``: holds text rather than numbers. ``beside``: texts that may stand beside the unit.
    """

    names: tuple[str, ...]
    units: Units = field(default_factory=lambda: {"": 1.0})
    needed: bool = True
    is_text: bool = False
    by_place: bool = True
    beside: re.Pattern[str] | None = None

    @property
    def title(self) -> str:
        """Name and unit as this program's tables have them."""
        unit = "" if callable(self.units) else next(iter(self.units), "")
        return "_".join(filter(None, (self.names[0], unit)))

    def factor_of(self, cell: str, below: str = "") -> float | None:
        """The factor of the unit in the name ``cell``, or in the row of units ``below`` it.

        NaN for an unknown unit, and for two that differ; None if the cell names another quantity.
        """
        behind = self._behind_name(_spelt(cell))
        if behind is None:
            return None
        given = [unit for unit in map(_unit_in, (behind, _spelt(below))) if unit]
        factors = [self._factor(unit) for unit in given] or [self._factor("")]
        return factors[0] if all(factor == factors[0] for factor in factors) else nan

    def _behind_name(self, cell: str) -> str | None:
        """The rest of ``cell`` after its name, or a % before it; None if the cell does not begin with a name."""
        if self.beside is not None:
            cell = self.beside.sub(" ", cell)
        for name in sorted(self.names, key=len, reverse=True):
            pattern = r"[\W_]*".join(map(re.escape, re.findall(r"[^\W_]+", _spelt(name))))
            match = re.match(rf"(\W*){pattern}(?![^\W_])", cell)
            if match is not None and not _SUM.match(cell, match.end()):
                return cell[match.end() :] + ("%" if "%" in match[1] else "")
        joined = re.fullmatch(rf"({'|'.join(map(re.escape, self.names))})([^\W\d_]+)", cell)  # as in xmm
        known = joined is not None and not callable(self.units) and joined[2] in self.units
        return joined[2] if joined is not None and known else None

    def _factor(self, unit: str) -> float:
        if callable(self.units):
            return self.units(unit)
        spellings = (_canonical(unit), _canonical(unit.removeprefix("/")))
        return next((self.units[spelling] for spelling in spellings if spelling in self.units), nan)


Places = dict[int, tuple[int, float]]  # by the number of a wanted column: its place in the table, and its factor


@dataclass(frozen=True)
class Names:
    """Names of a table's columns in ``line`` of the file ``name``, and the ``units`` in a row below them, if any."""

    name: str
    line: Line
    cells: Sequence[str]
    units: Sequence[str] = ()

    @property
    def where(self) -> str:
        """The line, for messages."""
        return f"{self.name}, line {self.line.number}"

    def places(self, wanted: Sequence[Column]) -> Places:
        """Place and factor of each of the ``wanted``, by its number.

        Raises :class:`InputError` for a repeated name, and for an unknown unit.
        """
        places: Places = {}
        doubtful: dict[int, list[int]] = {}
        for place, cell in enumerate(self.cells):
            label = self._place(place)
            if cell and plain(cell) in map(plain, self.cells[:place]):
                raise InputError(f"{label} is there twice; leave out one")
            known = {
                at: factor for at, column in enumerate(wanted) if (factor := self._factor(column, place)) is not None
            }
            fitting = {at: factor for at, factor in known.items() if not isnan(factor)}
            if known and not fitting:
                doubtful[place] = list(known)
            for at, factor in list(fitting.items())[:1]:
                if at in places:
                    raise InputError(f"{label}: a second column {wanted[at].title}; leave out one")
                places[at] = (place, factor)
        for place, columns in doubtful.items():
            if not places.keys() & set(columns):
                allowed = _allowed([wanted[at].units for at in columns])
                raise InputError(f"{self._place(place)}: its unit must be {allowed}")
        return places

    def require(self, places: Places, wanted: Sequence[Column]) -> None:
        """Raise :class:`InputError` for a needed column that has none of the ``places``."""
        missing = [column.title for at, column in enumerate(wanted) if column.needed and at not in places]
        if missing:
            listed = ", ".join(map(shown, self.cells[:_MOST_SHOWN]))
            raise InputError(f"{self.where}: no column {missing[0]}; found {listed}; name it so if it is one of them")

    def left_over(self, places: Places, read: Sequence[int] = ()) -> str:
        """Phrase for unused columns, beside those of ``places`` and those ``read`` otherwise; "" without any."""
        used = {*read, *(place for place, _ in places.values())}
        unused = [shown(cell) for place, cell in enumerate(self.cells) if place not in used and cell]
        return f"columns that are not used: {', '.join(unused[:_MOST_SHOWN])}" if unused else ""

    def _factor(self, column: Column, place: int) -> float | None:
        return column.factor_of(self.cells[place], self.units[place] if place < len(self.units) else "")

    def _place(self, place: int) -> str:
        below = f" with {shown(self.units[place])} below" if place < len(self.units) and self.units[place] else ""
        return f"{self.where}, column {place + 1}: {shown(self.cells[place])}{below}"


@dataclass(frozen=True)
class Heading:
    """The lines above the rows of a table of ``width`` columns: ``titles``, and ``remarks`` after a #."""

    name: str
    titles: Sequence[Line]
    remarks: Sequence[Line]
    dialect: Dialect
    width: int

    def names(self, wanted: Sequence[Column], *, further: bool = False) -> Names | None:
        """The names of the columns; None if no line has any. ``further``: the last columns may be unnamed.

        Raises :class:`InputError` if all names are unknown, if their number differs, and for a row below them that
        holds no units.
        """
        lines = sorted((*self.titles, *self.remarks), reverse=True)
        rows = [header_cells(line, self.dialect, self.name) for line in lines]
        fitting = [place for place, cells in enumerate(rows) if self._fits(cells, further) and _is_named(cells, wanted)]
        named = [place for place in fitting if not _are_units(rows[place])] or fitting  # "nm" is a name, and a unit
        if not named:
            self._refuse_unknown(wanted)
            return None
        below = reversed(list(zip(lines, rows, strict=True))[: named[0]])
        return Names(self.name, lines[named[0]], rows[named[0]], self._units(list(below)))

    def _fits(self, cells: Sequence[str], further: bool) -> bool:
        return len(cells) == self.width or (further and 1 < len(cells) < self.width)

    def _units(self, below: Sequence[tuple[Line, Sequence[str]]]) -> list[str]:
        """The cells of the row of units ``below`` the names; empty without such a row."""
        for line, cells in below:
            if len(cells) <= self.width and any(map(_is_unit, cells)):
                return [*cells, *[""] * (self.width - len(cells))]
            if line in self.titles and any(map(plain, cells)):
                row = f"{self.name}, line {line.number}: {shown(line.text)}"
                raise InputError(f"{row} between names and numbers is no row of units; put # in front of a remark")
        return []

    def _refuse_unknown(self, wanted: Sequence[Column]) -> None:
        """Refuse a last line of words that is separated as the rows are: it would be lost as a title.

        Where blanks separate, it may be a title of as many words: a :class:`FileWarning` says that it is taken for one.
        """
        for line in self.titles[-1:]:
            cells = header_cells(line, self.dialect, self.name)
            mark = self.dialect.separator
            where = f"{self.name}, line {line.number}"
            listed = ", ".join(map(shown, cells[:_MOST_SHOWN]))
            titles = ", ".join(column.title for column in wanted if column.by_place)
            if len(cells) != self.width and any(_fits_one(cell, wanted) for cell in cells if len(cells) > 1):
                raise InputError(f"{where}: {len(cells)} names for {self.width} columns: {listed}; give each its name")
            if not len(cells) == self.width > 1 or mark not in line.text:
                return
            if mark != " ":
                raise InputError(f"{where}: names not known: {listed}; must be {titles}; put # in front of a title")
            fault = f"{where}: {listed}: taken as a title, and the columns as {titles}"
            warnings.warn(fault, FileWarning, stacklevel=1)


def _is_named(cells: Sequence[str], wanted: Sequence[Column]) -> bool:
    """True if a cell names a wanted column, or one known from other tables."""
    return any(_fits_one(cell, wanted) or _is_of_other_table(cell) for cell in cells)


def _are_units(cells: Sequence[str]) -> bool:
    return all(_is_unit(cell) or not _unit_in(cell) for cell in cells)


def _allowed(units: Sequence[Units]) -> str:
    """The units, as a phrase."""
    if any(map(callable, units)):
        return "one to which it is proportional, such as W/nm"
    names = [name for mapping in units if not callable(mapping) for name in mapping if name]
    return f"one of {', '.join(names)}" if names else "left out: it has none"


def _fits_one(cell: str, wanted: Sequence[Column]) -> bool:
    """True if a cell names one of the ``wanted``, its unit known or at least in brackets."""
    factors = [factor for column in wanted if (factor := column.factor_of(cell)) is not None]
    return any(not isnan(factor) for factor in factors) or (bool(factors) and re.search(r"[\[(]", cell) is not None)


def _is_of_other_table(cell: str) -> bool:
    return _OTHER_QUANTITY.match(cell) is not None or (_is_unit(cell) and plain(cell) not in _WORDS_TOO)


def _is_unit(cell: str) -> bool:
    """True for a unit, and for a product or quotient of units, as W/nm and mW cm-2."""
    unit = _unit_in(_spelt(cell))
    factors = re.split(r"[\s/*·]+", unit)
    return _canonical(unit) in _UNITS or {_EXPONENT.sub("", _canonical(factor)) for factor in factors} <= _UNITS


def header_cells(line: Line, dialect: Dialect, name: str) -> list[str]:
    """Names in a header line, separated as the rows are or otherwise, without comment marks in front."""
    line = Line(line.number, _COMMENT_MARK.sub("", line.text))
    for separator in (dialect.separator.strip(" "), ";", "\t", ","):
        if separator and separator in line.text:
            cells = Dialect(separator).cells(line, name)
            return cells[: max((place for place, cell in enumerate(cells, start=1) if cell), default=0)]
    return _NAME.findall(line.text) if dialect.separator == " " else [line.text.strip()]


def doubt_degrees(angles_deg: Sequence[float], where: str, title: str) -> None:
    """Warn if angles of incidence end so early that they may be radians; ``title``: name of such a column."""
    if 0.0 < max(angles_deg) < QUARTER_TURN_RAD:
        doubt = f"its angles end at {max(angles_deg):.4g} degrees: in radians the column is {title}"
        warnings.warn(f"{where}: {doubt}", FileWarning, stacklevel=1)
