"""Numbers of a rendered page or screen, each held against the value of a record that a test names for its label."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from lensforge.results import Metric

SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_POWER = r"(?:\u2009×\u200910[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+|e[-+]?\d+)"  # as a page or a terminal writes it
_GROUPED = r"\d{1,3}(?:[ \u2009,]\d{3})+"
_NUMBER = rf"(?<![\d.,])[-−]?(?:{_GROUPED}|\d+)(?:\.\d+)?{_POWER}?(?![.,]?\d)"
# No unit may follow a number without one.
_NO_UNIT = r"(?!\s?(?:[nµ]?m[²³]?|[mµ]?rad|mm[²³]?|W|lm|lx|cd|g|s|pixel|heights|per|1/mm)(?![\w])|\s?[%°])"
# Names that hold digits, which are no numbers: files, standards, hashes, the time of writing.
_NAMES = re.compile(
    r"\w*\.3mf\b|\w*\.tm25ray\b|\b3MF\b|\b3-D\b|\bAP2\d\d\b|\bTM-\d\d\b|\bLM-63\b|\bSHA-256\b|\bU[01]\b|"
    r"\b[0-9a-f]{64}\b|\b[0-9a-f]{16}…|\d{4}-\d\d-\d\d \d\d:\d\d UTC"
)


@dataclass(frozen=True)
class Place:
    """A text that a reader sees, and its ``label``: headings, row and column; ``names_row``: it is that of a row."""

    label: str
    text: str
    names_row: bool = False


@dataclass(frozen=True)
class Shown:
    """What must stand at ``label``: ``words``, with units, and ``{}`` in the place of each of ``values``."""

    label: str
    words: str
    values: tuple[float | None, ...]

    def found_in(self, text: str) -> list[re.Match[str]]:
        """Places in ``text`` that have these words, with any numbers."""
        parts = [re.escape(part) for part in self.words.split("{}")]
        ends = _NO_UNIT if self.words.endswith("{}") else r"(?![\w²³/])" if self.words[-1:].isalnum() else ""
        return list(re.finditer(f"({_NUMBER})".join(parts) + ends, text))

    def after(self, words: str) -> "Shown":
        """The same after other ``words``."""
        return Shown(self.label, f"{words}{self.words}", self.values)

    def before(self, words: str) -> "Shown":
        """The same before other ``words``."""
        return Shown(self.label, f"{self.words}{words}", self.values)

    def wrong(self, found: re.Match[str]) -> Iterator[str]:
        """A line for each number that is not the value rounded to its own digits."""
        before = self.words.split("{}")
        for text, words, value in zip(found.groups(), before, self.values, strict=False):
            if not is_rounded(text, value, error=words.endswith("± ")):
                yield f"{self.label}: {text} in {found.group()!r}, but the record has {value!r}"


def shown(label: str, words: str, *values: float | None) -> Shown:
    """What must stand at ``label``."""
    assert words.count("{}") == len(values), f"{label}: {words}: {values}"
    return Shown(label, words, values)


def problems(places: Sequence[Place], wanted: Iterable[Shown]) -> list[str]:
    """A line for each number that is wrong, each that nothing is wanted of, and what is wanted and shown nowhere."""
    found: list[str] = []
    at: dict[str, list[int]] = {}
    for index, place in enumerate(places):
        if not place.names_row:
            at.setdefault(place.label, []).append(index)
    named, covered = set(), {index: [] for index in range(len(places))}
    for each in wanted:
        named |= {each.label, each.label.rpartition(" / ")[0]}  # a row, where the label is that of one of its columns
        here = at.get(each.label, [])
        matches = [(index, match) for index in here for match in each.found_in(places[index].text)]
        if not matches:
            found.append(f"{each.label}: not {each.words!r} {each.values}, but {[places[k].text for k in here]}")
        for index, match in matches:
            covered[index].append(match.span())
            found += each.wrong(match)
    for index, place in enumerate(places):
        known = place.names_row and place.label in named
        if not known and re.search(r"\d", _without(place.text, covered[index])):
            found.append(f"{place.label}: of no record: {place.text!r}")
    return found


def _without(text: str, spans: Iterable[tuple[int, int]]) -> str:
    """``text`` without ``spans`` and without names that hold digits."""
    letters = list(text)
    for start, end in spans:
        letters[start:end] = "\0" * (end - start)
    return _NAMES.sub("", "".join(letters))


def is_rounded(text: str, value: float | None, *, error: bool = False) -> bool:
    """True where ``text`` is ``value`` rounded to the digits that it has; ``error``: one of them is enough."""
    if value is None:
        return False
    plain = text.replace("−", "-").replace(",", "").replace(" ", "")
    mantissa, _, power = plain.replace("\u2009×\u200910", "e").replace("\u2009", "").partition("e")
    exponent = int(power.translate(SUPERSCRIPTS) or 0)
    found, last = float(mantissa) * 10.0**exponent, 10.0 ** (exponent - len(mantissa.partition(".")[2]))
    if isinstance(value, int):
        return found == value
    if abs(found - value) <= 0.5 * last * (1.0 + 1e-9) + 1e-12 * abs(value):
        return True
    # "12 800" has three digits: what follows them is no more than their size.
    return "." not in mantissa and any(found == float(f"{value:.{k}g}") for k in range(1 if error else 2, 7))


def with_error(label: str, metric: Metric, unit: str = "", factor: float = 1.0) -> Shown:
    """A metric ``factor`` times as large, with its standard error where that is known and not 0."""
    value, error = factor * metric.value, metric.standard_error
    if not error:
        return shown(label, f"{{}}{unit}", value)
    both = f"{{}}{unit} ± {{}}{unit}" if unit == "\u2009%" else f"{{}} ± {{}}{unit}"
    return shown(label, both, value, factor * error)
