"""Files of the measured points of several parts: a folder with one file a part, called CAVITY_PART.

What stands before the last underscore of a name is the cavity of the mould from which the part came. Where no name has
an underscore, all parts are of one cavity.
"""

from dataclasses import dataclass
from pathlib import Path

from lensforge.errors import InputError

LEAST_PARTS = 2
_MOST_PARTS = 200
_EXAMPLE = "cavity3_part12.csv"


@dataclass(frozen=True)
class PartFile:
    """The file of the points of one part, and its cavity; "" where no name states one."""

    path: Path
    cavity: str = ""


def part_files(path: Path) -> list[PartFile]:
    """The file at ``path`` alone, or all files of the folder, by cavity and part.

    Raises :class:`InputError` for a folder of fewer than two files or of too many, or where only some names state a
    cavity.
    """
    if not path.is_dir():
        return [PartFile(path)]
    files = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    if not LEAST_PARTS <= len(files) <= _MOST_PARTS:
        raise InputError(
            f"{path}: {len(files)} files of points, must be from {LEAST_PARTS} to {_MOST_PARTS}, one a part, called "
            f"such as {_EXAMPLE}; give the file itself for one part, which has no scatter and no Cp"
        )
    unnamed = [file.name for file in files if "_" not in file.stem]
    if unnamed and len(unnamed) < len(files):
        raise InputError(
            f"{path}: {unnamed[0]} states no cavity, {len(files) - len(unnamed)} other files do; call all such as "
            f"{_EXAMPLE}, the cavity before the last underscore, or none"
        )
    named = [PartFile(file, file.stem.rpartition("_")[0].strip()) for file in files]
    return sorted(named, key=lambda part: part.cavity)
