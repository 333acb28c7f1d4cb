"""The report on folders of every kind: each number on it is the value of a record that a table here names."""

import numpy as np
import pytest
from page_places import places_of
from page_text import undrawn_page_of
from shown_folders import FOLDERS, folder_of
from shown_numbers import Place, is_rounded, problems, shown
from wanted_frame import frame_numbers
from wanted_light import light_numbers
from wanted_measured import measured_numbers
from wanted_others import other_numbers
from wanted_part import part_numbers
from wanted_records import record_numbers
from wanted_snapshots import snapshot_numbers, title_of
from wanted_studies import study_numbers
from wanted_waterfalls import flux_places, waterfall_numbers

from lensforge.report.snapshots import FOLDER, Snapshot, outer_slope

WANTED = (
    light_numbers, part_numbers, study_numbers, measured_numbers, other_numbers, frame_numbers, record_numbers,
    waterfall_numbers,
)  # fmt: skip


@pytest.mark.parametrize("name", FOLDERS)
def test_every_number_of_the_report_is_that_of_a_record(name):
    results = folder_of(name)
    places = [*places_of(undrawn_page_of(results)), *flux_places(results)]
    assert "\n".join(problems(places, [each for wanted in WANTED for each in wanted(results)])) == ""


def test_every_number_of_a_snapshot_is_that_of_its_own_level(tmp_path):
    results = folder_of("search only")
    surface, slope = outer_slope(results.lens)
    taken = [
        Snapshot(
            inputs={"lens": results.lens.sha256}, level=level, functions=functions, step=step, nmse=nmse,
            efficiency=efficiency, width=300.0, height=300.0, far_field=False, irradiance=np.eye(8),
            surface_mm=surface, slope=slope,
        )
        for level, functions, step, nmse, efficiency in (
            (1, 16, 120, 0.3125, 0.6127), (2, 64, 1240, 0.0421, 0.7423), (10, 144, 12350, 0.00123, 0.8129),
        )
    ]  # fmt: skip
    for each in reversed(taken):
        each.write(tmp_path / FOLDER, f"level-{each.level}")
    places = [*places_of(undrawn_page_of(results, tmp_path)), *flux_places(results)]
    wanted = [each for wanted in WANTED for each in wanted(results)]
    assert "\n".join(problems(places, [*wanted, *snapshot_numbers(taken)])) == ""
    assert [each.text for each in places if each.text.startswith("Level ")] == list(map(title_of, taken))


def test_a_number_that_nothing_is_wanted_of_is_named_and_what_is_shown_nowhere():
    places = [Place("Size / Got", "radius 8.5 mm"), Place("Size / Asked", "≤ 11 mm")]
    wanted = [shown("Size / Got", "radius {} mm", 8.4999), shown("Height / Got", "{} mm", 5.0)]
    nowhere, unknown = problems(places, wanted)
    assert "Height / Got: not '{} mm'" in nowhere and "Size / Asked: of no record" in unknown


@pytest.mark.parametrize(
    ("text", "label", "words", "value"),
    [
        ("8.5 mm", "Got", "{} mm", 4.25),
        ("8.5 µm", "Got", "{} mm", 8.5),
        ("8.5 mm", "Got", "{}", 8.5),
        ("8.5 mm²", "Got", "{} mm", 8.5),
        ("8.5 mm", "Asked", "{} mm", 8.5),
        ("8.5 mm", "Got", "{} mm", None),
        ("rms 8.5 mm", "Got", "largest {} mm", 8.5),
    ],
)
def test_another_value_unit_or_label_is_a_problem(text, label, words, value):
    assert problems([Place("Got", text)], [shown(label, words, value)])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.0123", 0.012345), ("12\u2009800", 12822.25), ("12\u2009345", 12345), ("−0.7", -0.7413),
        ("3\u2009×\u200910⁻⁵", 3.1e-5), ("1e-05", 1.4e-5), ("8,388,608", 8388608), ("1.2300", 1.23),
    ],
)  # fmt: skip
def test_a_number_is_rounded_to_its_own_digits(text, value):
    assert is_rounded(text, value)
    assert not is_rounded(text, 1.2 * value if isinstance(value, float) else value + 1)
