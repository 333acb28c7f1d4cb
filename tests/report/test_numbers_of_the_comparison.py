"""The page of compared designs: each number on it is that of the design whose column it stands in."""

from dataclasses import replace

import pytest
from page_places import places_of
from shown_folders import folder_of
from shown_numbers import problems
from told_apart import told_apart
from undrawn import undrawn
from wanted_comparison import best_of, comparison_numbers

from lensforge.report.compare_page import render_comparison

GROUPS = {
    "every stage": ("every stage", "coated", "every stage"),
    "several receivers": ("several receivers", "several receivers", "uniform region"),
    "other kinds": ("far field", "limits missed", "moulded", "ray file"),
    "uniform region": ("uniform region", "uniform region"),
    "no light": ("search only", "moulded"),
}
_NAMES = ("left", "middle", "right", "last")


def _designs(folders):
    """Results by name; those of each design differ from those of the others also where its records are alike."""
    designs, made = {}, {folder: folder_of(folder) for folder in dict.fromkeys(folders)}
    for times, (name, folder) in enumerate(zip(_NAMES, folders, strict=False)):
        results = made[folder]
        for _ in range(times):
            results = replace(results, found={stem: told_apart(each) for stem, each in results.found.items()})
        designs[name] = replace(results, lens=replace(results.lens, seed=7 + times))
    return designs


@pytest.mark.parametrize("group", GROUPS)
def test_every_number_of_a_comparison_is_that_of_its_own_design(group):
    designs = _designs(GROUPS[group])
    with undrawn():
        places = places_of(render_comparison(list(designs.values()), list(designs)))
    assert "\n".join(problems(places, comparison_numbers(designs))) == ""
    assert sorted(each.label for each in places if each.text == "best") == sorted(best_of(designs))
