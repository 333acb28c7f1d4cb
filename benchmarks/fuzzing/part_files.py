"""Files of a CAD kernel: STEP by entities and references, 3MF by the XML in its archive."""

import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from fuzzing.archives import Member, changed_archive, members_of, zipped
from fuzzing.chance import Chance
from fuzzing.extremes import FLOATS, WORDS
from fuzzing.kind import Files, Kind
from fuzzing.noise import damaged
from fuzzing.samples import BASE_FILE, result_folder

_REFERENCE = re.compile(rb"#\d+")
_NUMBER = re.compile(rb"-?\d+\.\d*(?:[eE][-+]?\d+)?")
_ENTITY = re.compile(rb"(?m)^#\d+ ?=[^;]*;")
_KEYWORD = re.compile(rb"[A-Z_]{6,}")
_ATTRIBUTE = re.compile(rb'"[^"<>]{0,40}"')
_ENTITY_DEFINITIONS = [b'<!ENTITY a%d "%s">' % (k, (b"&a%d;" % (k - 1) if k else b"&a;") * 10) for k in range(9)]
_ENTITIES = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">' + b"".join(_ENTITY_DEFINITIONS) + b"]>"  # a billion letters


def _changed_step(chance: Chance, content: bytes) -> bytes:
    """References shuffled, numbers at their bounds, entities left out, doubled, or of another kind."""
    if chance.share(0.15):
        return damaged(chance, content)
    references = _references(content)
    for _ in range(chance.pick((1, 1, 2, 5, 50))):
        kind = chance.below(7)
        if kind < 3:
            content = _substituted(chance, content, _REFERENCE, chance.pick(references))
        elif kind == 3:
            value = chance.pick((*(f"{x!r}" for x in FLOATS), "$", "*", "''", "()", "#1", ".T.", "1.E999"))
            content = _substituted(chance, content, _NUMBER, value.encode())
        elif kind == 4:
            content = _substituted(chance, content, _ENTITY, b"")
        elif kind == 5:
            found = _near(chance, content, _ENTITY)
            content = (
                content if found is None else content[: found.end()] + b"\n" + found.group() + content[found.end() :]
            )
        else:
            other = _near(chance, content, _KEYWORD)
            content = content if other is None else _substituted(chance, content, _KEYWORD, other.group())
    return content


@cache
def _references(content: bytes) -> list[bytes]:
    return sorted(set(_REFERENCE.findall(content[:200_000])))


def _near(chance: Chance, content: bytes, pattern: re.Pattern[bytes]) -> re.Match[bytes] | None:
    return pattern.search(content, chance.below(len(content)))


def _substituted(chance: Chance, content: bytes, pattern: re.Pattern[bytes], new: bytes) -> bytes:
    found = _near(chance, content, pattern)
    return content if found is None else content[: found.start()] + new + content[found.end() :]


def _read_step(folder: Path) -> object:
    from lensforge.cad.step import parse_step

    return parse_step((folder / "lens.step").read_bytes()).shape.Volume()


def _read_base(folder: Path) -> object:
    from lensforge.cad.custom_base import read_custom_base

    return read_custom_base(folder / BASE_FILE)


@cache
def _threemf() -> list[Member]:
    """The members of a 3MF file of a small mesh: the first triangles of the sample's are enough."""
    members = members_of((result_folder() / "lens.3mf").read_bytes())
    return [replace(each, content=_shortened(each.content), method=zipfile.ZIP_DEFLATED) for each in members]


def _shortened(content: bytes) -> bytes:
    """The XML of a mesh with its first triangles alone; their vertices stay."""
    start, end = content.find(b"<triangles>"), content.find(b"</triangles>")
    if start < 0:
        return content
    kept = content[start:end].split(b"/>")[:400]
    body = content[:start] + b"/>".join(kept) + b"/>" + content[end:]
    return re.sub(
        rb"(?s)<t:trianglesets>.*</t:trianglesets>|<[a-z]*:?trianglesets>.*?</[a-z]*:?trianglesets>", b"", body
    )


def _changed_xml(chance: Chance, member: Member) -> Member:
    content = member.content
    for _ in range(chance.few()):
        kind = chance.below(7)
        if kind < 3:
            content = _substituted(chance, content, _ATTRIBUTE, b'"%s"' % chance.pick(WORDS).encode("utf-8", "replace"))
        elif kind == 3:
            content = damaged(chance, content)
        elif kind == 4:
            found = _near(chance, content, re.compile(rb"<[^<>]{1,200}>"))
            repeats = chance.pick((1, 2, 5000))
            content = (
                content if found is None else content[: found.end()] + found.group() * repeats + content[found.end() :]
            )
        elif kind == 5:
            content = _substituted(chance, content, re.compile(rb"<[^<>]{1,200}>"), b"")
        else:
            at = content.find(b"?>") + 2
            content = content[:at] + _ENTITIES + content[at:].replace(b"lens", b"&a8;", 1)
    return replace(member, content=content)


def _read_threemf(folder: Path) -> object:
    from lensforge.cad.mesh_files import parse_3mf

    return parse_3mf((folder / "lens.3mf").read_bytes())


def _kind(
    name: str,
    file: str,
    make: Callable[[Chance], bytes],
    read: Callable[[Path], object],
    original: Callable[[], bytes],
    share: float,
) -> Kind:
    def case(chance: Chance) -> Files:
        return {file: make(chance)}

    return Kind(name, case, read, lambda: [{file: original()}], share, foreign=True)


@cache
def _sample(name: str) -> bytes:
    return (result_folder() / name).read_bytes()


KINDS = [
    _kind(
        "step",
        "lens.step",
        lambda chance: _changed_step(chance, _sample("lens.step")),
        _read_step,
        lambda: _sample("lens.step"),
        0.2,
    ),
    _kind(
        "base",
        BASE_FILE,
        lambda chance: _changed_step(chance, _sample(BASE_FILE)),
        _read_base,
        lambda: _sample(BASE_FILE),
        0.5,
    ),
    _kind(
        "threemf",
        "lens.3mf",
        lambda chance: changed_archive(chance, _threemf(), _changed_xml),
        _read_threemf,
        lambda: zipped(_threemf()),
        0.5,
    ),
]
