"""The page and the screen of a trade-off: each number on them is that of the level or preset whose row it stands in."""

from made_tradeoff import make_tradeoff
from page_places import places_of
from result_folders import small_lens
from screen_places import places_of as lines_of
from shown_numbers import problems
from told_apart import told_apart
from undrawn import undrawn
from wanted_tradeoff import tradeoff_lines, tradeoff_numbers

from lensforge.commands.screen import print_screen
from lensforge.commands.sweep_blocks import tradeoff_block
from lensforge.studies.tradeoff.page import tradeoff_page


def test_every_number_of_a_tradeoff_is_that_of_its_level_or_preset(capsys):
    found = told_apart(make_tradeoff(small_lens()))
    with undrawn():
        places = places_of(tradeoff_page(found))
    assert "\n".join(problems(places, tradeoff_numbers(found))) == ""
    print_screen([tradeoff_block(found)])
    assert "\n".join(problems(lines_of(capsys.readouterr().out), tradeoff_lines(found))) == ""
