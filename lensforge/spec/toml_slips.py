"""Slips of the hand in a TOML file: the line, a caret beneath the place, and the line as it was meant.

The standard library's reader names a place and ends at the first slip. A line whose cure is known is read as it was
meant, and the reading goes on, so that one message names all of them. A cure is told only where TOML takes it.
"""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lensforge.errors import InputError, WrongFields, shortened
from lensforge.results.numerals import unit_in
from lensforge.spec.toml_bounds import TooLarge, bounded_tables

_MOST_SLIPS = 20  # in a message
_MOST_READ_ON = 100_000  # characters of a text that is read again and again, each time with one more slip mended
_LONGEST_CURED = 1000  # characters of a line that is searched for its cure
_MOST_COLUMNS = 100  # of a line that is shown
_BEFORE = 60  # columns of a longer line that stay before the caret
_PLACE = re.compile(r"\s*\(at (?:line (\d+), column (\d+)|end of document)\)$")
_TWICE = re.compile(r"^Cannot (?:overwrite a value|declare .* twice)")
_NAME = r"\w[\w.-]*"
_LINES: tuple[tuple[re.Pattern[str], str, str], ...] = (  # a line, what is wrong with it, and what is meant
    (re.compile(r"^(\s*)(?://|/\*|;|%|!|--)\s*(.*)$"), "a comment begins with #", r"\1# \2"),
    (re.compile(rf"^(\s*{_NAME}\s*=.*\S)\s+(?://|;)(.*)$"), "a comment begins with #", r"\1 #\2"),
    (re.compile(rf"^\s*\[+\s*\[+\s*({_NAME})\s*[\])]*\s*[:;,]?\s*$"), "a list's section has two brackets", r"[[\1]]"),
    (re.compile(rf"^\s*[\[(]\s*({_NAME})\s*[\])]*\s*[:;,]?\s*$"), "a section stands in brackets", r"[\1]"),
    (re.compile(rf"^(\s*)({_NAME})\s*(?::=|==>?|=>|:)\s*(\S.*)$"), "= stands between name and value", r"\1\2 = \3"),
    (re.compile(rf"^(\s*)({_NAME})\s+([\d\"'+-].*)$"), "= is missing between name and value", r"\1\2 = \3"),
)
_BLANKS = re.compile(r"^\s*(\w+(?:[ -]+\w+)+)(\s*=.*)$")
_ENTRY = re.compile(rf"^(\s*{_NAME}\s*=\s*)(.*?)\s*$")
_STRAIGHT = str.maketrans({**dict.fromkeys("“”„‟«»", '"'), **dict.fromkeys("‘’‚‛", "'"), "\xa0": " "})


@dataclass(frozen=True)
class ValueCure:
    """A ``fault`` of a value, and the value ``meant``; ``told``: the fault names it already."""

    fault: str
    meant: str
    told: bool = False


@dataclass(frozen=True)
class _Slip:
    """A ``fault`` at ``column`` of line ``number``, from 1; ``meant``: that line as it may be read on."""

    number: int
    column: int
    line: str
    fault: str
    meant: str | None = None

    @property
    def marked(self) -> str:
        """The line and, beneath it, a caret at the column."""
        start = max(0, self.column - 1 - _BEFORE) if len(self.line) > _MOST_COLUMNS else 0
        shown = shortened(self.line[start:].replace("\t", " "), _MOST_COLUMNS)
        return f"  {shown}\n  {' ' * (self.column - 1 - start)}^"


def tables_of(text: str, path: Path) -> dict[str, Any]:
    """The tables of a TOML ``text`` from ``path``; line ends of any system.

    Raises :class:`WrongFields`: a complete line for each slip, and beneath it the place; :class:`InputError` for a text
    that is larger, or nested deeper, than any spec.
    """
    lines = re.split(r"\r\n|\n|\r", text)
    most = _MOST_SLIPS if len(text) <= _MOST_READ_ON else 1
    slips: list[_Slip] = []
    while len(slips) < most:
        try:
            tables = bounded_tables("\n".join(lines))
        except TooLarge as error:
            raise InputError(f"{path}: {error}") from None
        except ValueError as error:
            slips.append(_slip(lines, str(error)))
        else:
            if not slips:
                return tables
            break
        if slips[-1].meant is None:
            break
        lines[slips[-1].number - 1] = slips[-1].meant
    raise _wrong(slips, path)


def _wrong(slips: list[_Slip], path: Path) -> WrongFields:
    places = (f"{path}: line {slip.number}, column {slip.column}: {slip.fault}" for slip in slips)
    error = WrongFields("\n".join(" ".join(place.split()) for place in places))
    if path.suffix.lower() == ".toml":  # the content of a file that was given by mistake is nobody's business
        error.beneath = tuple(slip.marked for slip in slips)
        error.add_note("\n".join(error.beneath))
    return error


def _slip(lines: list[str], message: str) -> _Slip:
    """The slip that the reader's ``message`` is about; a text without its end is noticed in the next line."""
    place = _PLACE.search(message)
    last = max((k for k, line in enumerate(lines, start=1) if line.strip()), default=1)
    number, column = (int(place[1]), int(place[2])) if place and place[1] else (last, len(lines[last - 1]) + 1)
    problem = _PLACE.sub("", message)
    if _TWICE.match(problem):
        return _repeated(lines, number)
    for line_number in (number, number - 1):
        line = lines[line_number - 1] if 1 <= line_number <= len(lines) else ""
        curable = line.strip() and len(line) <= _LONGEST_CURED and not _reads(line)
        cure = _cure(line) if curable else None
        if cure is not None:
            return _Slip(
                line_number, min(column, len(line) + 1) if line_number == number else len(line) + 1, line, *cure
            )
    line = lines[number - 1] if number <= len(lines) else ""
    return _Slip(number, column, line, f"not readable as TOML ({problem[:1].lower()}{problem[1:]})")


def _repeated(lines: list[str], number: int) -> _Slip:
    """The slip of a section or a name that stands in an earlier line, too."""
    line = lines[number - 1]
    name = line.split("=")[0].strip() if not line.lstrip().startswith("[") else line.split("#")[0].strip()
    same = re.compile(rf"\s*{re.escape(name)}\s*(?:=|#|$)")
    earlier = [k for k, line in enumerate(lines[: number - 1], start=1) if same.match(line)]
    where = f"stands in line {earlier[-1]}, too" if earlier else "is given twice"
    meant = None if name.startswith("[") else ""  # the fields of a second section would be read as another's
    return _Slip(number, len(line) - len(line.lstrip()) + 1, line, f"{shortened(name)} {where}; keep one", meant)


def _cure(line: str) -> tuple[str, str] | None:
    """Words on what is wrong with ``line`` and what to write, and the line that may be read in its place."""
    straight = line.translate(_STRAIGHT)
    if straight != line and _reads(straight):
        return f"quotes and blanks must be plain ones; write {shortened(straight.strip())}", straight
    for pattern, correction, meant in _LINES:
        cured_line = pattern.sub(meant, line) if pattern.match(line) else ""
        if cured_line and _reads(cured_line):
            return f"{correction}; write {shortened(cured_line.strip())}", cured_line
        if (
            cured_line and (within := _cured_entry(cured_line)) and _reads(within.meant)
        ):  # a second slip in the same line
            return f"{correction}, and {within.fault}", within.meant
    blanks = _BLANKS.match(line)
    if blanks and _reads(joined := f"{re.sub('[ -]+', '_', blanks[1])}{blanks[2]}"):
        return f"a name has no blanks; write {shortened(joined)}", joined
    entry = _cured_entry(line)
    return (entry.fault, entry.meant) if entry is not None and _reads(entry.meant) else None


def _cured_entry(line: str) -> ValueCure | None:
    entry = _ENTRY.match(line)
    cure = cured_value(entry[1].split("=")[0].strip(), entry[2]) if entry else None
    if entry is None or cure is None:
        return None
    meant = f"{entry[1]}{cure.meant}" if cure.meant else ""
    write = f"; write {shortened(meant.strip())}" if meant and not cure.told else ""
    return ValueCure(f"{cure.fault}{write}", meant)


def _reads(line: str) -> bool:
    try:
        tomllib.loads(line)
    except (ValueError, RecursionError):
        return False
    return True


# Values as people type them, and as TOML wants them.
_DIGITS = r"\d{1,3}(?:[.,'’\s]\d{3})+(?:[.,]\d+)?|\d+(?:[.,]\d*)?|[.,]\d+"  # in groups of three, or in one
_NUMERAL = re.compile(rf"([+-]?)({_DIGITS})\s*([eE][+-]?\d+)?\s*([^\W\d_]\S*|[%°\"″].*)?")
_SEVERAL = re.compile(r"[+-]?[\d.]+(?:\s*,\s*[+-]?[\d.]+){2,}")
_DATE = re.compile(r"(\d{1,4})([./-])(\d{1,2})\2(\d{1,4})")
_TRUTH = {**dict.fromkeys(("true", "yes", "on"), "true"), **dict.fromkeys(("false", "no", "off"), "false")}
_NOTHING = ("none", "null", "nil", "n/a", "-", "?")


def cured_value(name: str, value: str) -> ValueCure | None:
    """The cure of the text ``value`` of the field ``name``, as it stands behind ``=``; None if none is known."""
    if value[:1] in ('"', "'"):
        return _quoted(value)
    text = value.split("#")[0].strip()
    if not text:
        return ValueCure("its value is missing", "", told=True)
    if text[-1] in ",;":
        rest = text[:-1].strip()
        return cured_value(name, rest) or ValueCure(f"a value ends without {text[-1]!r}", rest)
    if text[0] in "[(":
        return _list(name, text)
    if _SEVERAL.fullmatch(text) and not _NUMERAL.fullmatch(text):
        return ValueCure("several values stand in brackets", f"[{text}]")
    if text.lower() in _TRUTH:
        return ValueCure("it is true or false", _TRUTH[text.lower()])
    if text.lower() in _NOTHING:
        return ValueCure("a field without a value is left out", "", told=True)
    return _date(text) or cured_number(name, text) or _words(text)


def cured_number(name: str, text: str) -> ValueCure | None:
    """The cure of a number with a comma, thousands marks or a unit; None for what is no number."""
    match = _NUMERAL.fullmatch(text)
    if match is None:
        return None
    sign, digits, power, unit = (group or "" for group in match.groups())
    digits = re.sub(r"['’\s]", "", digits)
    marks = [mark for mark in digits if mark in ".,"]
    rule = "a number has a decimal point, and no other marks"
    if marks == [","] and re.fullmatch(r"[1-9]\d{0,2},\d{3}", digits) and not unit:
        whole = digits.replace(",", "")
        point = digits.replace(",", ".")
        return ValueCure(f"{rule}; write {sign}{whole}, or {sign}{point}", f"{sign}{whole}", told=True)
    number = f"{sign}{_plain(digits)}{power}"
    if not unit:
        return ValueCure(rule, number) if number != text else None
    field_unit = unit_in(name)
    if field_unit and unit != field_unit:
        return ValueCure(
            f"{name} is in {field_unit}; write the number of {field_unit}, without a unit", number, told=True
        )
    return ValueCure("a number stands without its unit", number)


def _plain(digits: str) -> str:
    """``digits`` with a point alone: the last mark is the decimal one, unless it stands more than once."""
    last = max(digits.rfind("."), digits.rfind(","))
    if last < 0 or digits.count(digits[last]) > 1:
        whole = re.sub("[.,]", "", digits)
        decimals = ""
    else:
        whole = re.sub("[.,]", "", digits[:last])
        decimals = digits[last + 1 :]
    whole = whole.lstrip("0") or "0"
    return f"{whole}.{decimals or '0'}" if last >= 0 and digits.count(digits[last]) == 1 else whole


def _quoted(value: str) -> ValueCure | None:
    """The cure of a text that has a backslash, no end, or something behind its end."""
    mark = value[0]
    closed = re.fullmatch(rf"{mark}([^{mark}]*){mark}\s*(?:#.*)?", value)
    if closed and "\\" in closed[1] and mark == '"':
        path = closed[1].replace("\\\\", "\\")
        forward = path.replace("\\", "/")
        rule = "in double quotes a backslash begins an escape; paths may have / as well"
        return ValueCure(rule, f"'{path}'" if "'" not in path else f'"{forward}"')
    if value.count(mark) == 1:
        return ValueCure(f"the closing {mark} is missing", f"{value.split('#')[0].rstrip()}{mark}")
    behind = re.fullmatch(rf"({mark}[^{mark}]*{mark})\s*[,;]\s*(?:#.*)?", value)
    if behind:
        return ValueCure(f"a value ends without {value.split('#')[0].rstrip()[-1]!r}", behind[1])
    several = re.fullmatch(rf"{mark}[^{mark}]*{mark}(?:\s*,\s*{mark}[^{mark}]*{mark})+", value)
    return ValueCure("several values stand in brackets", f"[{value}]") if several else None


def _list(name: str, text: str) -> ValueCure | None:
    """The cure of a list with other brackets, with semicolons, blanks, decimal commas or words without quotes."""
    inside = text.strip("[]()").strip()
    part = r"\s*;\s*" if ";" in inside else r"\s*,\s*" if re.search(r",\s|,[^\d]", inside) else r"\s+"
    part = r"\s*,\s*" if "," in inside and part == r"\s+" and not re.search(r"\s", inside) else part
    entries = [entry for entry in re.split(part, inside) if entry]
    cured = [entry if _is_value(entry) or not (cure := cured_value(name, entry)) else cure.meant for entry in entries]
    return ValueCure("a list is [value, value]", f"[{', '.join(cured)}]")


def _is_value(entry: str) -> bool:
    return bool(re.fullmatch(r"[+-]?\d+(\.\d+)?([eE][+-]?\d+)?|true|false|\"[^\"\\]*\"|'[^']*'", entry))


def _date(text: str) -> ValueCure | None:
    match = _DATE.fullmatch(text)
    if match is None:
        return None
    first, mark, second, third = match.groups()
    rule = "a date is year-month-day"
    if len(first) == 4:
        return ValueCure(rule, f"{first}-{second:>02}-{third:>02}")
    if len(third) != 4:
        return None
    if mark == "/" and int(first) <= 12 and int(second) <= 12:  # the American order, or the British one
        either = [f"{third}-{a:>02}-{b:>02}" for a, b in ((first, second), (second, first))]
        return ValueCure(f"{rule}; write {' or '.join(dict.fromkeys(either))}", either[0], told=True)
    day, month = (second, first) if int(second) > 12 else (first, second)
    return ValueCure(rule, f"{third}-{month:>02}-{day:>02}")


def _words(text: str) -> ValueCure | None:
    text = text.rstrip("\"'")
    if not re.match(r"[^\W\d_]|[/.~_]", text) or '"' in text:
        return None
    mark = "'" if "\\" in text and "'" not in text else '"'
    return ValueCure("text needs quotes", f"{mark}{text}{mark}")
