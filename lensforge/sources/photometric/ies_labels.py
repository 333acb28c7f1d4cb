"""Labels of LM-63, by edition: first line, keywords, length of lines.

An edition of 1986 has no first line, and free text. That of 1991 requires [TEST] and [MANUFAC], 1995 no keyword; 2002
and 2019 require [TEST], [TESTLAB], [ISSUEDATE] and [MANUFAC], and 2019 has [FILEGENINFO] for what the number of the
file generation type leaves open. Lines of labels have 80 characters up to 1995, later 256, the two of their end
included; [MORE] continues the label before. After ANSI/IESNA LM-63-02, the overview of the five editions by the authors
of Radiance's ies2rad, and for 2019 the programs named in ``generation``.
"""

import re
from collections.abc import Iterator
from textwrap import wrap
from typing import Literal, get_args

from lensforge.errors import InputError
from lensforge.sources.photometric.record import PhotometricFile, single_line

IesVersion = Literal[1986, 1991, 1995, 2002, 2019]
NEWEST: IesVersion = 2019
_FIRST_LINES: dict[IesVersion, str] = {
    1991: "IESNA91",
    1995: "IESNA:LM-63-1995",
    2002: "IESNA:LM-63-2002",
    2019: "IES:LM-63-2019",
}
_SHORT, _LONG = 78, 254  # characters of a line, without those of its end
_EDITION = re.compile(r"IES(?:NA)?:\s*LM-63-(\d{4})|IESNA(91)\s*$", re.IGNORECASE)
_LABEL = re.compile(r"\[\s*(\w+)\s*\][ \t]*(.*)$")
_NOT_STATED = "not stated"  # in labels that a file must have


def require_ies_version(version: int) -> IesVersion:
    """``version`` if it is a year of LM-63. Raises :class:`InputError`."""
    for known in get_args(IesVersion):
        if version == known:
            year: IesVersion = known
            return year
    years = ", ".join(map(str, get_args(IesVersion)))
    raise InputError(f"ies_version = {version!r}: {years}; leave it out for {NEWEST}")


def label_lines(photometric: PhotometricFile, version: IesVersion) -> list[str]:
    """Lines of a file of the edition ``version`` above that of TILT=."""
    if version == 1986:  # free text must not hold the beginning of the numbers
        texts = (photometric.title, photometric.maker, photometric.test, photometric.laboratory, *photometric.remarks)
        return [line for text in texts for line in _wrapped(re.sub("TILT *=", "TILT ", text, flags=re.I), _SHORT)]
    lines = [_FIRST_LINES[version]]
    for keyword, text in _labels(photometric, version):
        width = (_LONG if version >= 2002 else _SHORT) - len("[MORE] ") - max(len(keyword) - len("MORE"), 0)
        first, *rest = _wrapped(text, width) or [""]
        lines += [f"[{keyword}] {first}".rstrip(), *(f"[MORE] {more}" for more in rest)]
    return lines


def _labels(photometric: PhotometricFile, version: IesVersion) -> Iterator[tuple[str, str]]:
    """Keywords and their texts, those that ``version`` requires before the others."""
    yield "TEST", photometric.test or _NOT_STATED
    if version >= 2002:
        yield "TESTLAB", photometric.laboratory or _NOT_STATED
        yield "ISSUEDATE", photometric.issued or _NOT_STATED
    yield "MANUFAC", photometric.maker or _NOT_STATED
    if photometric.catalogue:
        yield "LUMCAT", photometric.catalogue
    yield "LUMINAIRE", photometric.title
    if version >= 2019 and photometric.method:
        yield "FILEGENINFO", photometric.method
    for remark in photometric.remarks:
        yield "OTHER", remark


def _wrapped(text: str, width: int) -> list[str]:
    return wrap(single_line(text), width, break_on_hyphens=False)


def read_labels(head: str) -> tuple[int, dict[str, str]]:
    """Year of the edition, and the labels in ``head``, all above TILT=: the first of each keyword, continued by [MORE].

    A file without first line is one of 1986, and its first line of text the name of the luminaire.
    """
    lines = [line.strip() for line in head.split("\n") if line.strip()]
    named = _EDITION.match(lines[0]) if lines else None
    year = 1986 if named is None else int(named.group(1) or 1991)
    labels: dict[str, str] = {}
    last = ""
    for line in lines:
        label = _LABEL.match(line)
        if label is None:
            continue
        keyword, text = label.group(1).upper(), label.group(2).strip()
        if keyword == "MORE":
            labels[last] = f"{labels.get(last, '')} {text}".strip()
        else:
            last = keyword if keyword not in labels else ""
            labels.setdefault(keyword, text)
    if named is None and lines and not labels:
        labels["LUMINAIRE"] = lines[0]
    return year, {keyword: "" if text == _NOT_STATED else text for keyword, text in labels.items() if keyword}
