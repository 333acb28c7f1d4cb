"""Files of a result folder that a reader of the page may open or take."""

from pathlib import Path

DOWNLOADS = {
    ".html", ".pdf", ".dxf", ".step", ".stl", ".3mf", ".glb", ".gldf", ".ies", ".ldt", ".iesxml", ".tm25ray", ".csv",
    ".json",
}  # fmt: skip


def files_to_take(folder: Path) -> list[str]:
    """Names of the files in ``folder`` that a reader may open or take."""
    fit = (name for name in regular_files(folder) if Path(name).suffix.lower() in DOWNLOADS)
    return sorted(fit)


def regular_files(folder: Path) -> list[str]:
    """Names of the files in ``folder``, without links, pipes and devices: reading one of these may never end."""
    paths = folder.iterdir() if folder.is_dir() else ()
    return [path.name for path in paths if path.is_file() and not path.is_symlink()]
