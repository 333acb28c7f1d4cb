"""The table of dependencies in docs/architecture.md has those of pyproject.toml, each with its reason."""

import re
import tomllib

from page_sources import ROOT

TOOLS = {"dev", "docs", "all"}  # extras for tests and pages, and the one that is all others


def declared() -> dict[str, set[str]]:
    """Packages that pyproject.toml declares: those installed always as "", others by their extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {name: entries for name, entries in project["optional-dependencies"].items() if name not in TOOLS}
    lists = {"": project["dependencies"], **extras}
    return {name: {re.split(r"[<>=\[; ]", entry)[0] for entry in entries} for name, entries in lists.items()}


def test_every_direct_dependency_has_its_reason_and_none_is_stale() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = page.partition("## Dependencies")[2].partition("Weighed and refused")[0]
    rows = re.findall(r"^\| ([\w-]+) \| ([\w ]+) \| (.+) \|$", section, flags=re.MULTILINE)
    packages = {name: place for name, place, _ in rows if name != "package"}
    assert set(packages) == set().union(*declared().values())
    assert {name for name, place in packages.items() if place == "core"} <= declared()[""]
