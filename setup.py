"""Packages of the wheel: the program, and the shipped specs of examples/, which `lensforge examples` copies.

pyproject.toml says the rest. The specs are copied as a wheel is built, not named as a package in another folder: of
packages in one folder an editable install is a path, which type checkers read, too.
"""

import shutil
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

SHIPPED = ("*.toml", "published/*.toml", "made_lens/*", "*.png", "*.step", "*.ies", "*.tm25ray")


class BuildWithExamples(build_py):
    """A build whose wheel has examples/ as lensforge/shipped; a checkout has the folder itself."""

    def run(self) -> None:
        """Build, and copy the specs with the files that they name."""
        super().run()
        if self.editable_mode:
            return
        for path in (path for pattern in SHIPPED for path in sorted(Path("examples").glob(pattern))):
            copy = Path(self.build_lib, "lensforge", "shipped", path.relative_to("examples"))
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)


setup(
    packages=find_packages(include=["lensforge", "lensforge.*"]),
    package_dir={"": "."},
    package_data={
        "lensforge": [
            "compiled/*/*.nb[ci]",
            "report/templates/*",
            "shop/templates/*",
            "spec/*.csv",
            "search/*.csv",
            "addons/*/page/*",
            "addons/*/*.csv",
            "addons/*/scripts/*.py",
            "addons/*/road_surfaces/*.csv",
            "py.typed",
        ]
    },
    cmdclass={"build_py": BuildWithExamples},
)
