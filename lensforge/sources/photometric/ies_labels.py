"""Labels of IES LM-63: the edition in the first line, keywords and free text above TILT=, read and written.

An edition of 1986 has no first line, and free text; keywords began in 1991. Programs spell the first line in many ways:
with two digits of the year, blanks or underscores for dashes, ANSI before it. 2002 and 2019 require [TEST], [TESTLAB],
[ISSUEDATE] and [MANUFAC], and 2019 has [FILEGENINFO] for what the number of the file generation type leaves open. Lines
of labels have 256 characters, the two of their end included; [MORE] continues the label before. [OTHER] and free text
are remarks. What has no field in the record is kept by its keyword.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, Literal

from lensforge.errors import InputError
from lensforge.sources.photometric.photometric_file import PhotometricFile, single_line

IesVersion = Literal[2002, 2019]
NEWEST: IesVersion = 2019
FIRST_LINES: dict[IesVersion, str] = {2002: "IESNA:LM-63-2002", 2019: "IES:LM-63-2019"}
NOT_STATED = "not stated"  # in labels and elements that a file must have
_LONG = 254  # characters of a line, without those of its end
_EDITION = re.compile(r"LM[\W_]*63[\W_]*(\d{4}|\d{2})(?!\d)|^IES(?:NA)?[\W_]*(\d{4}|\d{2})\W*$", re.IGNORECASE)
_LABEL = re.compile(r"\[\s*(\w+)\s*\][ \t]*(.*)$")
_FIELDS = {
    "test": "TEST",
    "laboratory": "TESTLAB",
    "issued": "ISSUEDATE",
    "maker": "MANUFAC",
    "catalogue": "LUMCAT",
    "title": "LUMINAIRE",
    "method": "FILEGENINFO",
}
LAMP = "LAMP"
LAMP_CATALOGUE = "LAMPCAT"
_REMARK = "OTHER"
_MORE = "MORE"
_REQUIRED = ("TEST", "TESTLAB", "ISSUEDATE", "MANUFAC")
_SINCE_2002 = ("TESTLAB", "ISSUEDATE", "NEARFIELD", "LAMPPOSITION")  # keywords that no edition before has


def require_ies_version(version: int) -> IesVersion:
    """``version`` if it is a year of LM-63 that is written. Raises :class:`InputError`."""
    edition = next((year for year in FIRST_LINES if year == version), None)
    if edition is None:
        raise InputError(f"ies_version = {version!r}: 2002 or {NEWEST}; leave it out for {NEWEST}")
    return edition


def label_lines(photometric: PhotometricFile, version: IesVersion) -> list[str]:
    """Lines of a file of the edition ``version`` above that of TILT=."""
    lines = [FIRST_LINES[version]]
    for keyword, text in _labels(photometric, version):
        width = _LONG - len("[MORE] ") - max(len(keyword) - len(_MORE), 0)
        first, *continuation = wrap(single_line(text), width, break_on_hyphens=False) or [""]
        lines += [f"[{keyword}] {first}".rstrip(), *(f"[{_MORE}] {more}" for more in continuation)]
    return lines


def _labels(photometric: PhotometricFile, version: IesVersion) -> Iterator[tuple[str, str]]:
    """Keywords and their texts, required ones first."""
    for field, keyword in _FIELDS.items():
        text = getattr(photometric, field)
        if keyword in _REQUIRED or (text and (keyword != "FILEGENINFO" or version == NEWEST)):
            yield keyword, text or NOT_STATED
    lamp = photometric.lamps[0]
    yield from ((keyword, text) for keyword, text in ((LAMP, lamp.kind), (LAMP_CATALOGUE, lamp.catalogue)) if text)
    yield from ((keyword, text) for keyword, text in photometric.others if "/" not in keyword)
    yield from ((_REMARK, remark) for remark in photometric.remarks)


@dataclass(frozen=True)
class Labels:
    """Labels above TILT=: the year of the edition, and whether it is ``named``; texts by field of the record."""

    year: int
    named: bool
    fields: dict[str, Any]
    lamp: str
    lamp_catalogue: str
    remarks: tuple[str, ...]
    others: tuple[tuple[str, str], ...]


def read_labels(head: str) -> Labels:
    """Read the labels in ``head``, all above TILT=: a keyword's first text fills its field, later ones are kept.

    A file without first line is one of 1986, and its first line of text the name of the luminaire; unless keywords say
    that it is younger.
    """
    lines = [line.strip() for line in head.split("\n") if line.strip()]
    named = _EDITION.search(lines[0]) if lines else None
    pairs = list(_pairs(lines if named is None else lines[1:]))
    keywords = {keyword for keyword, _ in pairs if keyword}
    firsts: dict[str, str] = {}
    remarks: list[str] = []
    others: list[tuple[str, str]] = []
    for keyword, text in pairs:
        if named is None and not keywords and not firsts:
            firsts["LUMINAIRE"] = text
        elif keyword in ("", _REMARK):
            remarks.append(text)
        elif keyword in (*_FIELDS.values(), LAMP, LAMP_CATALOGUE) and keyword not in firsts:
            firsts[keyword] = text
        elif text:
            others.append((keyword, text))
    return Labels(
        year=_unnamed_year(keywords) if named is None else _year(named.group(1) or named.group(2)),
        named=named is not None,
        fields={field: firsts.get(keyword, "").replace(NOT_STATED, "") for field, keyword in _FIELDS.items()},
        lamp=firsts.get(LAMP, ""),
        lamp_catalogue=firsts.get(LAMP_CATALOGUE, ""),
        remarks=tuple(filter(None, remarks)),
        others=tuple(others),
    )


def _pairs(lines: list[str]) -> Iterator[tuple[str, str]]:
    """Keyword and text of each label, with continuations by [MORE]; free text has no keyword."""
    keyword = ""
    texts = list[str]()
    for line in lines:
        label = _LABEL.match(line)
        if label is not None and label.group(1).upper() == _MORE and texts:
            texts.append(label.group(2).strip())
            continue
        if texts:
            yield keyword, " ".join(filter(None, texts))
        keyword = "" if label is None else label.group(1).upper()
        texts = [line if label is None else label.group(2).strip()]
    if texts:
        yield keyword, " ".join(filter(None, texts))


def _year(digits: str) -> int:
    year = int(digits)
    return year if year >= 100 else year + (1900 if year >= 86 else 2000)


def _unnamed_year(keywords: set[str]) -> int:
    if keywords.intersection(_SINCE_2002):
        return 2002
    return 1991 if keywords else 1986
