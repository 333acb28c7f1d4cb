"""The page of compared designs: each number on it is that of the design whose column it stands in."""

from dataclasses import replace

import numpy as np
import pytest
from kept_figures import kept_figures
from page_places import places_of
from shown_folders import folder_of
from shown_numbers import problems
from told_apart import told_apart
from undrawn import undrawn
from wanted_comparison import best_of, comparison_numbers

from lensforge.light.evaluation_result import Light
from lensforge.made.measurement_result import PhotoComparison
from lensforge.report.compare_page import render_comparison
from lensforge.report.compare_pictures import ComparedPictures

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
            results = replace(results, found=results.found | _brighter_to_the_right(results))
        designs[name] = replace(results, lens=replace(results.lens, seed=7 + times))
    return designs


def _brighter_to_the_right(results):
    """The light and the photograph of the part, with other images."""
    found, light, photo = {}, results.find(Light), results.find(PhotoComparison)
    if light is not None:
        changed = []
        for each in light.receivers:
            ramp = np.linspace(0.8, 1.3, each.map.shape[1])
            changed.append(each.model_copy(update={name: ramp * getattr(each, name) for name in ("map", "raw_map")}))
        found["evaluate"] = light.model_copy(update={"receivers": tuple(changed)})
    if photo is not None:
        found["compare"] = photo.model_copy(update={"measured": 1.25 * photo.measured})
    return found


@pytest.mark.parametrize("group", GROUPS)
def test_every_number_of_a_comparison_is_that_of_its_own_design(group):
    designs = _designs(GROUPS[group])
    with undrawn():
        places = places_of(render_comparison(list(designs.values()), list(designs)))
    assert "\n".join(problems(places, comparison_numbers(designs))) == ""
    assert sorted(each.label for each in places if each.text == "best") == sorted(best_of(designs))


@pytest.mark.parametrize("group", ["every stage", "several receivers", "uniform region"])
def test_every_map_and_curve_of_a_comparison_is_that_of_its_own_design(group):
    designs = _designs(GROUPS[group])
    pictures = ComparedPictures(list(designs), list(designs.values()))
    with kept_figures() as figures:
        assert len([*pictures.maps, *pictures.curves, *pictures.photographs]) == len(figures)
    lights = {name: results.find(Light) for name, results in designs.items()}
    lit = {
        f"{name}, {each.name}" if len(light.receivers) > 1 else name: (light, each)
        for name, light in lights.items()
        for each in light.receivers
    }
    known = all(light.lumens_per_watt for light in lights.values())
    for name, (title, figure) in figures.items():
        axes = figure.axes[0]
        if name.startswith("map"):
            light, each = lit[title]
            per_watt = light.lumens_per_watt if known else 1.0
            np.testing.assert_allclose(axes.images[0].get_array(), per_watt * each.map, rtol=1e-12, err_msg=title)
        elif name.startswith("photo"):
            photo = designs[title].find(PhotoComparison)
            np.testing.assert_allclose(axes.images[0].get_array(), photo.measured, err_msg=title)
        for line in axes.lines if name.startswith(("across", "up", "circles")) else ():
            light, each = lit[line.get_label()]
            per_watt = light.lumens_per_watt if known else 1.0
            wanted = _curve(name, each, len(line.get_ydata())) * (1.0 if name.startswith("circles") else per_watt)
            np.testing.assert_allclose(line.get_ydata(), wanted, rtol=1e-9, err_msg=f"{title}, {line.get_label()}")


def _curve(name, each, count):
    """Light along a line through the middle of a receiver, or the share of its light in circles about it."""
    (rows, columns), (width, height) = each.map.shape, (each.width, each.height)
    x, y = (((np.arange(n) + 0.5) / n - 0.5) * side for n, side in ((columns, width), (rows, height)))
    if name.startswith("circles"):
        distance = np.hypot(x[None, :], y[:, None])
        radii = np.linspace(0.0, distance.max(), count)
        return np.array([each.raw_map[distance <= radius].sum() for radius in radii]) / each.raw_map.sum()
    image, at, side = (each.map, x, width) if name.startswith("across") else (each.map.T, y, height)
    middle = 0.5 * (image[len(image) // 2 - 1] + image[len(image) // 2])  # an even number of rows
    return np.interp(np.linspace(-0.5 * side, 0.5 * side, count), at, middle)
