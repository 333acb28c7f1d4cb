"""The version of this program, and of those that compute for it; every layer can import it."""

__version__ = "0.2.0"

_COMPUTE = ("torch", "numpy", "numba")  # another version of these may round differently


def made_by() -> dict[str, str]:
    """Versions of this program and of those that compute for it."""
    from importlib.metadata import PackageNotFoundError, version

    versions = {"lensforge": __version__}
    for name in _COMPUTE:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue  # such as a torch that was built in place: nothing is known of it
    return versions
