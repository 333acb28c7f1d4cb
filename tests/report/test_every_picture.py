"""Every picture of the page read back: pixels in their unit and on their side, lines, bars and the bars of errors.

The images are random and differ, so that a test fails where an image is taken for another, turned about or subtracted
the wrong way round. A picture that has neither a reader here nor a test elsewhere fails.
"""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from addon_rows import addon_rows
from drawn_page import TURNED
from made_yield import make_yield
from matplotlib.figure import Figure
from part_files import verified, whole_results
from result_folders import PIXELS, face_maps, make_check, make_light, small_lens
from shown_folders import SKY
from undrawn import without_views

from lensforge.light.seen_lens import SeenLens
from lensforge.report import light_figures, page
from lensforge.report.lens_page import render_report
from lensforge.results import Conditions
from lensforge.results.chart import LightUnit

LM_PER_W = 250.0
SQUARE = {**TURNED, "height_mm": 300.0}
ELSEWHERE = {  # the files of the tests that read these
    "line": "test_figures_read_back",
    "photo-line": "test_figures_read_back",
    "polar": "test_figures_read_back",
    "isocandela": "test_photometry_section",
    "section": "test_page_figures",
    "isolines": "test_page_figures",
    "encircled": "test_chart_figures",
}


def random_image(seed):
    return np.random.default_rng(seed).uniform(1.0, 40.0, (PIXELS, PIXELS))


def page_results():
    """Results whose images are random, with light by other rays, a study of parts and both faces apart."""
    lens = small_lens(lumens_per_watt=LM_PER_W, wanted={"receivers": (SQUARE, SKY)})
    face = make_check(lens).faces["inner"]
    twice = {name: 2.0 * values for name, values in face_maps().items()}
    study = make_yield(lens).model_copy(update={"worst_maps": random_image(13)[None]})
    fields = {
        "evaluate": {"map": random_image(1), "target_map": random_image(2), "raw_map": random_image(3)},
        "verify": {**verified(), "design_irradiance": random_image(4), "irradiance": random_image(5)},
        "stray": {"sequential": random_image(6), "direct": random_image(7), "stray": random_image(8)},
        **{stem: {name: random_image(seed) for name, seed in of.items()} for stem, of in addon_rows("SEEDS").items()},
        "check": {"outer": face.model_copy(update=twice)},
        "yield": study,
    }
    other = make_light(lens, conditions=Conditions.of(rays=64), map=random_image(14))
    return replace(whole_results(lens=lens, **fields), others={"evaluate_64rays": other})


@dataclass(frozen=True)
class Drawn:
    """A figure of the page: of the results ``of``, its number among those of its name."""

    figure: Figure
    of: object
    index: int

    @property
    def axes(self):
        return self.figure.axes[0]

    @property
    def pixels(self):
        """Values of its pixels, [row y, column x] from below."""
        (shown,) = self.axes.images
        assert shown.origin == "lower"
        return np.ma.filled(shown.get_array(), np.nan)

    @property
    def light(self):
        return self.of.light.receivers[self.index]


def number_of(name):
    """The name of a picture without the number of its receiver, and that number from 0."""
    plain, _, number = name.rpartition("-")
    return (plain, int(number) - 1) if plain and number.isdigit() else (name, 0)


def shows(value):
    """A reader of a map: its pixels are what ``value`` finds in the records, in lumens."""

    def read(drawn):
        assert drawn.pixels == pytest.approx(LM_PER_W * value(drawn))

    return read


def shows_relative(value):
    def read(drawn):
        assert drawn.pixels == pytest.approx(value(drawn))

    return read


def proof(drawn):
    return drawn.of.proof.receivers[drawn.index]


def stray(drawn):
    return drawn.of.found["stray"].receivers[drawn.index]


def shows_face(quantity, face):
    """A map of a face: x of the chart to the right; lengths in mm."""

    def read(drawn):
        values = getattr(drawn.of.check.faces[face], quantity).T
        known = np.isfinite(values) & np.isfinite(drawn.pixels) & (values != 0.0)
        assert known.sum() > 50
        scale = drawn.pixels[known] / values[known]
        assert scale == pytest.approx(scale[0]) and scale[0] in (1.0, pytest.approx(1000.0))
        unit = drawn.figure.axes[1].get_ylabel()
        assert ("µm" in unit) == (scale[0] > 2.0)

    return read


def bars(drawn):
    return [(patch.get_x(), patch.get_width()) for patch in drawn.axes.patches]


def flux_ends(drawn):
    emitted, *lost, detected = bars(drawn)
    assert emitted == (0.0, 1.0) and detected == pytest.approx((0.0, drawn.light.flux.detected))
    assert sum(width for _, width in lost) == pytest.approx(1.0 - drawn.light.flux.detected)


def stray_ends(drawn):
    flux = stray(drawn).flux
    texts = [text.get_text() for text in drawn.axes.texts]
    assert bars(drawn)[0] == (0.0, 1.0) and f"{100.0 * flux.detected_direct:.2f} %" in texts
    assert (0.0, pytest.approx(flux.detected_direct)) in bars(drawn)


def steps_of(quantity):
    def read(drawn):
        levels = drawn.of.design.history
        assert [line.get_ydata().tolist() for line in drawn.axes.lines] == [list(getattr(e, quantity)) for e in levels]

    return read


def margins(drawn):
    values = [list(line.get_ydata()) for line in drawn.axes.lines]
    for level in drawn.of.design.history:
        assert all(list(row) in values for row in level.constraints.values())


def gaps(drawn):
    receiver, lines = proof(drawn), {line.get_label(): line for line in drawn.axes.lines}
    named = {"exported mesh": "gaps_mesh_mm", "STEP file": "gaps_step_mm", "mesh, by Mitsuba": "gaps_mitsuba_mm"}
    asked = {name: getattr(receiver, field) for name, field in named.items()}
    for name, quantiles in asked.items():
        assert (quantiles is None) == (name not in lines)
        if quantiles is not None:
            x, y = lines[name].get_data()
            assert (np.interp(0.75, y, x), y[-1]) == pytest.approx((np.quantile(quantiles, 0.75), 1.0))
    assert lines["limit of the mesh's rms"].get_xdata()[0] == receiver.deviation_limit_mm


def parts(drawn):
    """Steps at the values of the parts without their noise, the value as designed, the bound on its wrong side."""
    study = drawn.of.found["yield"]
    metric = ("nmse", "share_in_target")[drawn.index]
    lines = {line.get_label(): line.get_xydata() for line in drawn.axes.lines}
    assert lines["parts"][:, 0] == pytest.approx(np.sort(study.without_noise(metric)))
    assert lines["parts"][[0, -1], 1].tolist() == [100.0 / study.parts, 100.0]
    assert lines["as designed"][0, 0] == study.metrics[metric].designed.value
    (bound,) = [bound for bound in study.bounds if bound.metric == metric]
    if "bound" in lines:
        assert lines["bound"][0, 0] == bound.bound
        wrong = drawn.axes.patches[-1].get_extents().transformed(drawn.axes.transData.inverted())
        beyond = wrong.x0 if bound.sense == "<=" else wrong.x1
        assert beyond == pytest.approx(bound.bound)


def causes(drawn):
    """Bars in per cent from 0, and bars of errors from a standard error below to one above, the first cause on top."""
    variance = list(drawn.of.found["yield"].variance.values())[drawn.index]
    shown = [(100.0 * cause.share, 100.0 * cause.standard_error) for cause in variance.certain]
    shown.append((100.0 * variance.interactions.value, 100.0 * variance.interactions.standard_error))
    assert len(shown) == 3 and bars(drawn) == [(0.0, pytest.approx(value)) for value, _ in shown]
    (errors,) = [collection for collection in drawn.axes.collections if hasattr(collection, "get_segments")]
    ends = [(segment[0, 0], segment[1, 0]) for segment in errors.get_segments()]
    assert ends == [pytest.approx((value - error, value + error)) for value, error in shown]
    assert drawn.axes.yaxis_inverted() and drawn.axes.get_yticklabels()[0].get_text() == variance.certain[0].words


READERS = {
    "first": shows(lambda d: d.light.map),
    "target": shows(lambda d: d.light.target_map),
    "simulated": shows(lambda d: d.light.map),
    "difference": shows(lambda d: d.light.map - d.light.target_map),
    "flux": flux_ends,
    "loss": steps_of("loss"),
    "error": steps_of("nmse"),
    "efficiency": steps_of("efficiency"),
    "margins": margins,
    **{f"{kind}-{face}": shows_face(quantity, face) for face in ("inner", "outer") for kind, quantity in (
        ("sag", "sag_mm"), ("curvature", "kappa_min"), ("uncut", "residual_mm"))},
    "design": shows(lambda d: proof(d).design_irradiance),
    "part": shows(lambda d: proof(d).irradiance),
    "part-minus-design": shows(lambda d: proof(d).irradiance - proof(d).design_irradiance),
    "gaps": gaps,
    "stray-budget": stray_ends,
    "stray-light": shows(lambda d: stray(d).stray),
    "unmodelled": shows(lambda d: stray(d).direct + stray(d).stray - stray(d).sequential),
    "other-0": shows(lambda d: d.light.map),
    "other-1": shows(lambda d: d.of.others["evaluate_64rays"].receivers[d.index].map),
    "yield": parts,
    "yield-causes": causes,
    "yield-worst0": shows(lambda d: d.light.map),
    "yield-worst1": shows(lambda d: d.of.found["yield"].worst_maps[0]),
    **addon_rows("PICTURES"),
}  # fmt: skip
COUNTED = r"(line|photo-line|section|yield-causes)(\d+)|(yield)-(\d+)"  # a number of its own at the end of the name


def drawn_figures(results):
    figures = {}

    def keep(figure, name, title):
        figures[name] = figure
        return "<svg/>"

    with without_views(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "to_svg", keep)
        render_report(results)
    return figures


@pytest.fixture(scope="module")
def drawn():
    results = page_results()
    pictures = {}
    for name, figure in drawn_figures(results).items():
        plain, index = number_of(name) if name not in READERS else (name, 0)
        counted = re.fullmatch(COUNTED, name if name not in READERS else "")
        if counted:
            plain, index = counted[1] or counted[3], int(counted[2] or counted[4])
        elif re.fullmatch(r"(photo-)?line\d-2", name):
            plain = "line"
        pictures[name] = plain, Drawn(figure, results, index)
    return pictures


def test_every_picture_has_a_reader(drawn):
    names = {plain for plain, _ in drawn.values()}
    assert names == {*READERS, *ELSEWHERE}, "a new picture is read back here, or its test is named"


@pytest.mark.parametrize("name", READERS)
def test_pictures_show_what_the_records_hold(drawn, name):
    of_name = [drawing for plain, drawing in drawn.values() if plain == name]
    assert of_name
    for picture in of_name:
        READERS[name](picture)


def test_the_lens_as_an_eye_sees_it_has_its_brightest_spot_in_the_circle():
    """20 by 20 pixels of 0.5 mm; the brightest at x = 3.25, y = -2.75 mm; above 10,000 in thousands."""
    radiance = np.full((20, 20), 2.0)
    radiance[4, 16] = 90.0
    corners = np.array([[-4.0, -3.0], [4.0, -3.0], [3.0, 4.0]])
    seen = SeenLens(label="eye", side_mm=10.0, spot_mm=0.8, outline=corners, mean=None, map=radiance)
    figure = light_figures.seen_lens(seen, LightUnit("luminance", "cd/m²", LM_PER_W))
    axes, scale = figure.axes
    assert np.asarray(axes.images[0].get_array()) == pytest.approx(1e-3 * LM_PER_W * radiance)
    assert scale.get_ylabel() == "luminance (kcd/m²)" and axes.images[0].get_clim() == (0.0, 22.5)
    circle, outline = axes.patches
    assert circle.center == pytest.approx((3.25, -2.75)) and circle.radius == 0.4
    assert outline.get_xy()[:3] == pytest.approx(corners)
