"""Zip archives, member by member: NumPy's arrays with their headers, and members that unpack to gigabytes."""

import bz2
import hashlib
import io
import json
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from fuzzing.chance import Chance
from fuzzing.extremes import FLOATS, NO_NUMBERS
from fuzzing.kind import Files, Kind
from fuzzing.noise import damaged
from fuzzing.ray_files import require_finite
from fuzzing.records import CHECKSUM, checksum, record_text, require_usable
from fuzzing.samples import result_folder
from lensforge.runs.results import EXTRAS, STAGES
from lensforge.sources.build_source import build_source
from lensforge.spec.source_sections import RadianceSource

_STAGES = (
    "evaluate",
    "verify",
    "stray",
    "photometry",
)  # results with arrays; those of a check are a hundred times larger
_CLASSES = {**{kind.stage: kind for kind in STAGES}, **EXTRAS}
_RADIANCE = "radiance.npz"
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
_BOMB_MIB = (1, 100, 1000)
_MIB = 2**20
_ZEROS = bytes(_MIB)
_PACKERS = {
    zipfile.ZIP_DEFLATED: lambda content: zlib.compress(content, 1)[2:-4],
    zipfile.ZIP_BZIP2: bz2.compress,
    zipfile.ZIP_LZMA: lambda content: b"\x09\x04\x05\0]\0\0\x80\0" + lzma.compress(content, lzma.FORMAT_ALONE)[13:],
}
_TYPES = (
    "<f8", ">f8", "<f4", "<f2", "<i8", "<u1", "|b1", "<c16", "|O", "<U5", "|S8", "<M8[s]", "|V16", "<f16", "f8",
    "<f0", "",
    "<U99999999", "[('a', '<f8')]",
)  # fmt: skip
_SHAPES = (
    "()", "(0,)", "(1,)", "(-1,)", "(10**9,)", "(1000000000000,)", "(2, 3)", "(0, 16)", "(16, 16)", "(16, 0)",
    "(1, 1, 1)", "(9223372036854775807, 9223372036854775807)", "(4294967296, 4294967296)", "(3.5,)", "('a',)",
    "None", "[16, 16]", "(16,", "((((((((1,),),),),),),),)", "(True, 16)",
)  # fmt: skip


@dataclass(frozen=True)
class Member:
    """A member of an archive: its name, content and packing."""

    name: str
    content: bytes
    method: int = zipfile.ZIP_STORED
    zeros_mib: int = 0  # that follow the content when it is unpacked


def members_of(content: bytes) -> list[Member]:
    """The members of an archive, unpacked."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return [Member(info.filename, archive.read(info), zipfile.ZIP_DEFLATED) for info in archive.infolist()]


def zipped(members: Sequence[Member]) -> bytes:
    """The archive of ``members``, in their order, with names as they are and no times."""
    body, directory = bytearray(), bytearray()
    for member in members:
        packed, crc, size = _packed(member)
        name = member.name.encode("utf-8", "replace")[:65_535]
        fields = struct.pack("<HHHHHIIIHH", 20, 0x800, member.method, 0, 33, crc, len(packed), size, len(name), 0)
        directory += b"PK\x01\x02\x14\0" + fields + struct.pack("<HHHII", 0, 0, 0, 0, len(body)) + name
        body += b"PK\x03\x04" + fields + name + packed
    end = struct.pack("<HHHHIIH", 0, 0, len(members), len(members), len(directory), len(body), 0)
    return bytes(body + directory) + b"PK\x05\x06" + end


def _packed(member: Member) -> tuple[bytes, int, int]:
    """Packed content, check sum and size of a member; zeros are never held unpacked."""
    if member.zeros_mib:
        packer = zlib.compressobj(1, zlib.DEFLATED, -15)
        packed = packer.compress(member.content) + packer.flush(zlib.Z_FULL_FLUSH) + _deflated_zeros(member.zeros_mib)
        return packed, _crc(member.content, member.zeros_mib), len(member.content) + member.zeros_mib * _MIB
    content = member.content
    packer = _PACKERS.get(member.method)
    return packer(content) if packer else content, zlib.crc32(content), len(content)


@cache
def _deflated_zeros(mebibytes: int) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    one = packer.compress(bytes(_MIB)) + packer.flush(zlib.Z_FULL_FLUSH)
    return one + (packer.compress(bytes(_MIB)) + packer.flush(zlib.Z_FULL_FLUSH)) * (mebibytes - 1) + packer.flush()


def _crc(content: bytes, mebibytes: int) -> int:
    found = zlib.crc32(content)
    for _ in range(mebibytes):
        found = zlib.crc32(_ZEROS, found)
    return found


def changed_archive(chance: Chance, members: list[Member], change: Callable[[Chance, Member], Member]) -> bytes:
    """The archive with a few members changed by ``change``, repacked, renamed, doubled or left out; or damaged."""
    found = list(members)
    for _ in range(chance.few(3)):
        if not found:
            break
        at = chance.below(len(found))
        kind = chance.below(12)
        if kind < 6:
            found[at] = change(chance, found[at])
        elif kind == 6:
            found[at] = replace(found[at], method=chance.pick(_METHODS))
        elif kind == 7:
            name = chance.pick(
                (found[chance.below(len(found))].name, "../x.npy", "/x", "", "x" * 5000, "\u202e", "a\nb", "x.npy")
            )
            found[at] = replace(found[at], name=name)
        elif kind == 8:
            found.insert(at, found[at])
        elif kind == 9:
            del found[at]
        elif kind == 10:
            found += [
                replace(found[at], name=f"{k}.npy", content=b"", zeros_mib=0) for k in range(chance.pick((1, 20, 3000)))
            ]
        else:
            head = found[at].content[:128]
            found[at] = Member(found[at].name, head, zipfile.ZIP_DEFLATED, zeros_mib=chance.pick(_BOMB_MIB))
    content = zipped(found)
    if chance.share(0.3):
        content = _directory(chance, content) if chance.share(0.6) else damaged(chance, content)
    return content


def _directory(chance: Chance, content: bytes) -> bytes:
    """Another number in an entry of the archive's directory, or in the header of a member."""
    data = bytearray(content)
    mark = chance.pick((b"PK\x01\x02", b"PK\x03\x04", b"PK\x05\x06"))
    starts = [k for k in range(len(data) - 4) if data[k : k + 4] == mark] if len(data) < 2**20 else []
    if starts:
        offset = chance.pick(starts) + 4 + 2 * chance.below(20)
        data[offset : offset + 2] = chance.pick((b"\0\0", b"\xff\xff", b"\x01\0", b"\0\x80", chance.bytes(2)))
    return bytes(data)


def changed_array(chance: Chance, member: Member) -> Member:
    """A `.npy` file with another header, or other numbers."""
    content, kind = member.content, chance.below(8)
    size = int.from_bytes(content[8:10], "little")
    header, data = content[10 : 10 + size], content[10 + size :]
    if kind == 0:
        text = _dictionary(descr=repr(chance.pick(_TYPES)))
    elif kind == 1:
        text = _dictionary(shape=chance.pick(_SHAPES))
    elif kind == 2:
        text = _dictionary(fortran_order=chance.pick(("True", "1", "None", "__import__('os').getcwd()")))
    elif kind == 3:
        text = chance.pick(("{}", "{" * 200, "[1]", "None", "", "{'descr': '<f8'}", "(" * 5000, "x" * 60_000))
    elif kind == 4:
        return replace(member, content=damaged(chance, content))
    elif kind == 5:
        return replace(member, content=content[:6] + bytes([chance.below(5), chance.below(2)]) + content[8:])
    else:
        numbers = bytearray(data)
        for _ in range(chance.few()):
            at = 8 * chance.below(max(len(data) // 8, 1))
            numbers[at : at + 8] = struct.pack("<d", chance.pick((*FLOATS, *NO_NUMBERS)))
        if chance.share(0.3):
            numbers = bytearray(np.full(len(data) // 8, chance.pick((*FLOATS, *NO_NUMBERS)), "<f8").tobytes())
        return replace(member, content=content[: 10 + size] + bytes(numbers))
    line = text.encode()[:65_000]
    return replace(member, content=content[:8] + len(line).to_bytes(2, "little") + line + data if header else content)


def _dictionary(descr: str = "'<f8'", fortran_order: str = "False", shape: str = "(16, 16)") -> str:
    return f"{{'descr': {descr}, 'fortran_order': {fortran_order}, 'shape': {shape}, }}".ljust(117) + "\n"


@cache
def _stage_members(stem: str) -> list[Member]:
    return members_of((result_folder() / f"{stem}.npz").read_bytes())


def _make_arrays(chance: Chance) -> Files:
    """The arrays of a result, mostly with a record that states their new hash."""
    stem = chance.pick(_STAGES)
    archive = changed_archive(chance, _stage_members(stem), changed_array)
    record = json.loads(record_text(stem))
    if chance.share(0.8):
        record["arrays_sha256"] = hashlib.sha256(archive).hexdigest()
        if CHECKSUM in record:
            record[CHECKSUM] = checksum(record)
    return {f"{stem}.npz": archive, f"{stem}.json": json.dumps(record).encode()}


def _read_arrays(folder: Path) -> object:
    """Read every result that has arrays; those that are accepted are finite, and have the hash that is stated."""
    found = []
    for stem in _STAGES:
        found.append(require_usable(_CLASSES[stem].read(folder, stem)))
        stated = json.loads((folder / f"{stem}.json").read_text(encoding="utf-8"))["arrays_sha256"]
        if hashlib.sha256((folder / f"{stem}.npz").read_bytes()).hexdigest() != stated:
            raise ValueError("accepted, with arrays of another hash")
    return found


@cache
def _radiance_members() -> list[Member]:
    arrays = {
        "x_mm": np.array([-0.5, 0.0, 0.5]), "y_mm": np.array([-0.5, 0.5]), "c_deg": np.array([0.0, 180.0, 360.0]),
        "gamma_deg": np.array([0.0, 45.0, 90.0]), "radiance": np.ones((1, 2, 3, 3)) * [3.0, 2.0, 1.0],
    }  # fmt: skip
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return members_of(stream.getvalue())


def _read_radiance(folder: Path) -> object:
    source = build_source(RadianceSource(file=folder / _RADIANCE))
    bundle = source.sample(16, 1)
    require_finite(bundle.origins, bundle.directions, bundle.flux)
    return source.symmetry


KINDS = [
    Kind("arrays", _make_arrays, _read_arrays, lambda: [{"x": b""}], 2.0, foreign=True, in_folder=True),
    Kind(
        "radiance",
        lambda chance: {_RADIANCE: changed_archive(chance, _radiance_members(), changed_array)},
        _read_radiance,
        lambda: [{_RADIANCE: zipped(_radiance_members())}],
        1.0,
        foreign=True,
    ),
]
