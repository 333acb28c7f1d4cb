"""The page and the screen of a trade-off: each number on them is that of the level or preset whose row it stands in."""

from kept_figures import kept_figures
from made_tradeoff import make_tradeoff
from page_places import places_of
from result_folders import small_lens
from screen_places import places_of as lines_of
from shown_numbers import problems
from told_apart import told_apart
from undrawn import undrawn
from wanted_tradeoff import tradeoff_lines, tradeoff_numbers

from lensforge.cli.screen import print_screen
from lensforge.cli.sweep_blocks import tradeoff_block
from lensforge.runs.tradeoff.page import tradeoff_page


def test_every_number_of_a_tradeoff_is_that_of_its_level_or_preset(capsys):
    found = told_apart(make_tradeoff(small_lens()))
    with undrawn():
        places = places_of(tradeoff_page(found))
    assert "\n".join(problems(places, tradeoff_numbers(found))) == ""
    print_screen([tradeoff_block(found)])
    assert "\n".join(problems(lines_of(capsys.readouterr().out), tradeoff_lines(found))) == ""


def test_every_point_of_a_tradeoff_is_a_level_over_its_time_or_setting():
    found = told_apart(make_tradeoff(small_lens()))
    with kept_figures() as figures:
        tradeoff_page(found)
    for study in found.studies.values():
        for error in study.plotted:
            axes = figures.pop(f"{study.name}-{error}")[1].axes[0]
            drawn = {str(each.get_label()): each.lines[0].get_xydata() for each in axes.containers}
            wanted = {}
            for level in study.levels[:-1]:  # the last is the reference
                at = level.seconds if study.against == "seconds" else level.setting
                if at and level.errors[error].value > 0.0:
                    wanted[level.series] = [[at, level.errors[error].value]]
            assert {series: points.tolist() for series, points in drawn.items()} == wanted, error
            unit = {"um": "µm"}.get(study.units[error], study.units[error])
            assert axes.get_ylabel().endswith(f" ({unit})" if unit else axes.get_ylabel())
            assert axes.get_xlabel() == ("seconds" if study.against == "seconds" else study.knob)
    assert figures == {}
