"""The section on other conditions, the box of warnings, and the top line of the page: the verdict."""

from dataclasses import replace

import pytest
from page_text import Page, text_of, undrawn_page_of
from result_folders import make_folder, make_light, make_proof, make_results, small_lens, with_leds

from lensforge.light.receiver_light import Flux
from lensforge.report.compare import ComparedPictures, number_lines
from lensforge.report.light_section import other_lights, other_pictures, other_results
from lensforge.report.results import Results
from lensforge.report.stored import load_results
from lensforge.results import Conditions, Metric

ATTACK = "<img src=x onerror=alert(1)>"


def with_others(*others):
    results = make_results()
    stems = {f"{other.stage}_{other.conditions.name}": other for other in others}
    return Results(results.lens, results.found, results.outdated, stems)


def dim_light(lens=None, **changes):
    conditions = Conditions.of(source_name="cold", source="ray file cold.ray", rays=64, source_sha256="ab" * 32)
    conditions = conditions.model_copy(update={"warnings": (f"98 % backward {ATTACK}",)})
    content = {
        "conditions": conditions,
        "efficiency": Metric(value=0.0, standard_error=0.0),
        "share_in_target": Metric(value=0.0, standard_error=0.0),
        "flux": Flux(detected=0.0, outside=0.0, missed=0.03, total_reflection=0.0, not_converged=0.0, reflected=0.97),
        "rays": 64,
    }
    return make_light(lens or small_lens(), **(content | changes))


def test_light_under_other_conditions_stands_beside_the_own():
    results = with_others(dim_light())
    nominal, other = other_lights(results)
    assert (nominal.title, nominal.fact("efficiency").text, nominal.state) == (
        "nominal",
        "85.000 ± 0.020\u2009%",
        "pass",
    )
    assert (other.title, other.fact("source").text) == ("cold_64rays", "ray file cold.ray")
    assert other.fact("rays").text == "64"
    assert (other.fact("efficiency").text, other.state) == ("0\u2009%", "fail")
    assert "Light in the target = 0\u2009%, must be" in other.note
    assert len(other_pictures(results)) == 2
    text = text_of(results)
    section = text[text.index("Other conditions") :]
    assert section.index("nominal") < section.index("98 % backward") < section.index("ray file cold.ray")
    assert "evaluate_cold_64rays.json" in text


def test_light_of_several_leds_under_other_conditions_has_a_row_and_a_picture_of_each():
    near, dim = make_light(small_lens()), dim_light(conditions=None)
    light = type(near).joined({"near": near, "far": dim})
    other = light.changed(conditions=Conditions.of(rays=64), others=(dim.changed(led="far", rays=77),))
    results = Results(with_leds(small_lens(), "near", "far"), {"evaluate": light}, {}, {"evaluate_64rays": other})
    rows = other_lights(results)
    assert [(row.title, row.fact("efficiency").text, row.fact("rays").text, row.state) for row in rows] == [
        ("nominal, near", "85.000 ± 0.020\u2009%", "65\u2009536", "pass"),
        ("nominal, far", "0\u2009%", "64", "fail"),
        ("64rays, near", "85.000 ± 0.020\u2009%", "65\u2009536", "pass"),
        ("64rays, far", "0\u2009%", "77", "fail"),
    ]  # fmt: skip
    drawn = other_pictures(results)
    assert [picture.title for picture in drawn] == ["nominal, near", "nominal, far", "64rays, near", "64rays, far"]


def test_other_light_changes_nothing_above_its_section():
    plain, other = (undrawn_page_of(results) for results in (make_results(), with_others(dim_light())))
    menu = '<a href="#other">Other conditions</a>\n'
    end = other.index('<h2 id="other"')
    assert menu in other and other[:end].replace(menu, "") == plain[: end - len(menu)]


def test_other_results_say_their_conditions_and_misses():
    proof = make_proof(small_lens(), conditions=Conditions.of(rays=64), inputs={})
    proof = proof.model_copy(
        update={"criteria": tuple(replace(criterion, limit=0.001).judged() for criterion in proof.criteria)}
    )
    (row,) = other_results(with_others(proof))
    assert (row.title, row.fact("conditions").text) == ("verify_64rays.json", "64 rays")
    assert "Efficiency of the part 84.75\u2009%" in row.fact("figures").text
    assert row.note.startswith("missed: ") and "; missed: deviation_rms = 0.0125 mm" in row.note
    text = text_of(with_others(proof))
    assert "All 39 criteria on simulation and files are met" in text, "those of the lens's own results"


def test_designs_are_compared_by_their_own_light():
    plain, other = make_results(), with_others(dim_light())
    assert number_lines([other, plain]) == number_lines([plain, plain])
    assert ComparedPictures(["a", "b"], [other, plain]).maps == ComparedPictures(["a", "b"], [plain, plain]).maps


def test_others_are_read_back_and_no_stage_takes_them(tmp_path):
    lens = small_lens()
    folder = make_folder(tmp_path / "run", lens=lens)
    other = dim_light(lens)
    other.write(folder, "evaluate_cold_64rays")
    results = load_results(folder)
    assert results.others == {"evaluate_cold_64rays": other}
    assert results.light == make_light(lens) and "evaluate_cold_64rays" not in results.found
    assert results.verdict == replace(results, others={}).verdict


@pytest.mark.parametrize(
    ("changes", "sentence", "shown"),
    [
        ({}, "Photometry, CAD files and manufacture pass.", "pass"),
        (
            {"nmse": Metric(value=0.46, standard_error=0.001)},
            "Photometry fails. CAD files and manufacture pass.",
            "fail",
        ),
        ({"nmse": Metric(value=0.1, standard_error=0.01)}, "Photometry is undecided.", "open"),
    ],
)
def test_the_top_line_is_the_verdict(changes, sentence, shown):
    page = undrawn_page_of(make_results(evaluate=changes))
    text = Page(page).text
    assert f'<p class="verdict {shown}">' in page
    assert text.index(sentence) < text.index("The light")
    assert (
        text.index(sentence)
        < text.index("All 39 criteria on simulation and files are met")
        < text.index("All criteria")
    )
