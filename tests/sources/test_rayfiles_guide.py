"""The guide's specs are specs, and its table names the formats that there are."""

import tomllib
from pathlib import Path

import pytest
from scenes import small_spec

from lensforge.sources.rayfiles.formats import FORMATS

GUIDE = (Path(__file__).parents[2] / "docs" / "rayfiles.md").read_text(encoding="utf-8")
SOURCES = [block.split("```")[0] for block in GUIDE.split("```toml\n")[1:]]


@pytest.mark.parametrize("text", SOURCES)
def test_every_source_and_lens_of_the_guide_is_valid(text):
    content = tomllib.loads(text)
    lens = {f"lens__{name}": value for name, value in content.pop("lens", {}).items()}
    spec = small_spec(**content, **lens, constraints__max_radius_mm=14.0)
    assert spec.source.title
    assert (spec.lens.dispersion is not None) == bool(lens)
    assert len(SOURCES) >= 6


def test_the_guide_names_every_format():
    for entry in FORMATS.values():
        assert f"| {entry.title.removesuffix(' (experimental)').removesuffix(' binary')}" in GUIDE.replace(
            "| CSV", "| comma-separated values"
        )
        assert all(suffix in GUIDE for suffix in entry.suffixes)
