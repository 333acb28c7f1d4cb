"""Print the lowest declared version of each direct dependency, as constraints for pip; torch has its own pin."""

import re
import tomllib
from pathlib import Path

project = tomllib.loads(Path(__file__).parents[1].joinpath("pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
addons = [name.removeprefix("lensforge[").removesuffix("]") for name in extras["all"]]
for requirement in (*project["dependencies"], *(library for addon in addons for library in extras[addon])):
    name, version = re.match(r"([\w-]+)>=([\d.]+)", requirement).groups()
    if name != "torch":
        print(f"{name}=={version}")
