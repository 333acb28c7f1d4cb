"""Packages of the wheel: the program, and the shipped specs of examples/, which `lensforge examples` copies.

pyproject.toml says the rest; it cannot add one folder to the packages that are found.
"""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["lensforge", "lensforge.*"]), "lensforge.shipped"],
    package_dir={"lensforge.shipped": "examples"},
    package_data={
        "lensforge": ["report/templates/*", "drawings/templates/*", "py.typed"],
        "lensforge.shipped": ["*.toml", "published/*.toml", "*.png", "*.step", "*.ies", "*.tm25ray"],
    },
)
