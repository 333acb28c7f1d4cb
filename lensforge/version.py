"""The version of this program, and of those that compute for it; every layer can import it."""

from collections.abc import Iterable

__version__ = "0.3.0"

_COMPUTE = ("torch", "numpy", "numba")  # another version of these may round differently


def made_by() -> dict[str, str]:
    """Versions of this program and of those that compute for it."""
    return {"lensforge": __version__, **versions_of(_COMPUTE)}


def versions_of(packages: Iterable[str]) -> dict[str, str]:
    """Versions of those of ``packages`` that are installed."""
    from importlib.metadata import PackageNotFoundError, version

    versions = {}
    for name in packages:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue  # such as a torch that was built in place: nothing is known of it
    return versions
