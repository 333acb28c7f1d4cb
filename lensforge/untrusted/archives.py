"""Bounds on 3MF and STEP files before a library opens them."""

import io
import zipfile

from lensforge.errors import InputError

_MIB = 2**20
# The 3MF of a mesh with 3 million triangles, the most that is read, has 400 MiB of XML in 4 members.
MOST_MEMBERS, MOST_UNPACKED_MIB = 64, 512
# 1 kB of memory for each entity; the STEP file of a lens has 1,500, that of a clamp with 1,000 faces 50,000.
MOST_STEP_MIB, MOST_ENTITIES = 128, 1_000_000


def require_small_3mf(content: bytes, origin: str, remedy: str) -> None:
    """Raise :class:`InputError` unless ``content`` is a ZIP archive whose directory states few and small members."""
    if content.count(b"PK\x01\x02") > MOST_MEMBERS:  # before a directory of millions is read
        raise InputError(f"{origin}: more than {MOST_MEMBERS} members, a 3MF file has about 4; {remedy}")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
    except Exception as error:  # zipfile raises many kinds on damaged directories; the cause is always the file
        raise InputError(f"{origin}: not readable as 3MF ({' '.join(str(error).split())[:120]}); {remedy}") from None
    if unpacked > MOST_UNPACKED_MIB * _MIB:
        raise InputError(
            f"{origin}: {unpacked / _MIB:.0f} MiB when unpacked, at most {MOST_UNPACKED_MIB} MiB are read; {remedy}"
        )


def require_small_step(content: bytes, origin: str, remedy: str) -> None:
    """Raise :class:`InputError` unless ``content`` begins as a STEP file does and has not too many entities."""
    if b"ISO-10303-21" not in content[:1024]:
        raise InputError(f"{origin}: not readable as STEP (it does not begin with ISO-10303-21); {remedy}")
    if len(content) > MOST_STEP_MIB * _MIB:
        raise InputError(
            f"{origin}: {len(content) / _MIB:.0f} MiB, at most {MOST_STEP_MIB} MiB of STEP are read; {remedy}"
        )
    entities = content.count(b";")  # each ends with one; texts may hold some more
    if entities > MOST_ENTITIES:
        raise InputError(f"{origin}: {entities} entities, at most {MOST_ENTITIES} are read; {remedy}")
