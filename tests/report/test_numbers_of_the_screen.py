"""The screens of a run and of its stages: each number on them is the value of a record that a table here names."""

from pathlib import Path

import pytest
from screen_places import places_of
from shown_folders import FOLDERS, folder_of
from shown_numbers import problems, shown
from wanted_screens import summary_numbers
from wanted_stage_screens import stage_numbers

from lensforge.cli.screen import print_screen
from lensforge.cli.stage_blocks import blocks_of
from lensforge.cli.summary import summary
from lensforge.runs.run_folder import Run


@pytest.mark.parametrize("name", FOLDERS)
def test_every_number_of_a_screen_is_that_of_a_record(name, capsys):
    results = folder_of(name)
    run = Run(results.lens, results.found, results.outdated, results.others, folder=Path("run"))
    print_screen(summary(run))
    assert "\n".join(problems(places_of(capsys.readouterr().out), summary_numbers(results))) == ""
    for stem, result in {**results.found, **results.others}.items():
        if stem != "design":  # its screen is that of the whole run
            print_screen(blocks_of(result, run))
            wanted = [*stage_numbers(result, results), *_conditions(result)]
            assert "\n".join(problems(places_of(capsys.readouterr().out), wanted)) == "", stem


def _conditions(result):
    """Entries of the line on other conditions than the lens's own, and of the name of the file."""
    conditions = getattr(result, "conditions", None)
    if conditions is not None:
        yield shown("Written", f"_{conditions.name}.json")
        yield shown("Written / Conditions", "{} rays", conditions.rays)
        if conditions.temperature_c is not None:
            yield shown("Written / Conditions", "{} °C", conditions.temperature_c)
