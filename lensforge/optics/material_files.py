"""Files of materials, by their suffix: glass catalogues, tables, and files of refractiveindex.info."""

from pathlib import Path

from lensforge.errors import InputError
from lensforge.optics.glass_catalogue import read_agf
from lensforge.optics.material import Material
from lensforge.optics.material_table import read_material_table
from lensforge.optics.refractive_index_info import read_refractive_index_info

SUFFIXES = (".agf", ".yml", ".yaml", ".csv", ".txt")


def read_material(path: Path, name: str | None) -> Material:
    """Read a material; ``name``: of the glass in a catalogue, or what the material is to be called.

    Raises :class:`InputError` for another kind of file, a catalogue without ``name``, and what cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a material is read from {', '.join(SUFFIXES)}")
    if suffix == ".agf":
        if name is None:
            raise InputError(f"{path}: name the glass in it by lens.material")
        return read_agf(path, name)
    called = path.stem if name is None else name
    if suffix in (".yml", ".yaml"):
        return read_refractive_index_info(path, called)
    return read_material_table(path, called)
