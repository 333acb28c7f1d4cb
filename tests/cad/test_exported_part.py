import json
import subprocess
import sys

import numpy as np
import pytest
from geometry_lenses import make_lens
from pydantic import ValidationError

import lensforge as lf
from lensforge.cad.part import Part, stamp_of
from lensforge.cad.part_export import build_part
from lensforge.cad.solid import Solid
from lensforge.cad.step import parse_surfaces
from lensforge.errors import InputError


@pytest.fixture(scope="module")
def part():
    return build_part(make_lens(0.8, 2.45, 0.01, base={"diameter_mm": 8.0}), rings=16, extension_deg=5.0)


def volume(shape):
    """Of a ``cadquery.Shape``, more closely than its own method has it."""
    return Solid(shape.wrapped, {}).volume_mm3


def content_of(part, **changed):
    return {name: getattr(part, name) for name in Part.model_fields} | changed


def test_the_solid_is_the_user_s_to_cut_fuse_and_export(part, tmp_path):
    import cadquery as cq

    solid = part.solid
    assert isinstance(solid, cq.Solid)
    assert solid is part.solid, "read once"
    assert volume(solid) == pytest.approx(part.volume_mm3, rel=1e-12)
    slot = cq.Workplane("XY").center(3.5, 0.0).rect(0.4, 0.4).extrude(-2.0)
    cut = cq.Workplane(solid).cut(slot).val()
    assert part.volume_mm3 - volume(cut) == pytest.approx(0.4 * 0.4 * 2.0, rel=1e-6)
    flange = cq.Workplane("XY").workplane(offset=-2.0).rect(12.0, 12.0).circle(3.0).extrude(-1.0)
    fused = cq.Workplane(solid).union(flange).val()
    assert fused.isValid()
    assert volume(fused) - part.volume_mm3 == pytest.approx(144.0 - 9.0 * np.pi, rel=1e-6)
    cq.exporters.export(cq.Workplane(fused), str(tmp_path / "held.step"))
    again = cq.importers.importStep(str(tmp_path / "held.step")).val()
    assert volume(again) == pytest.approx(volume(fused), rel=1e-9)
    assert len(parse_surfaces(part.surfaces_step)) == 2, "what cadquery has set does not matter to the next reader"


@pytest.mark.parametrize(
    ("name", "field"), [("a.step", "step"), ("a.STP", "step"), ("a.stl", "stl"), ("sub/a.3mf", "threemf")]
)
def test_a_file_is_saved_by_its_suffix_with_exactly_its_bytes(part, tmp_path, name, field):
    part.save(tmp_path / name)
    assert (tmp_path / name).read_bytes() == getattr(part, field)


def test_what_is_written_is_read_back_to_the_bit(part, tmp_path):
    part.write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*part.files, "export.json"}
    again = Part.read(tmp_path, lens=part.lens)
    assert again == part
    assert again.sha256 == part.sha256
    assert again.criteria == part.criteria


def test_a_file_too_many_or_too_few_is_refused(part):
    with pytest.raises(ValidationError, match=r"lens_surfaces\.step: no such file"):
        Part(**content_of(part, surfaces_step=None))
    without = {name: stamp for name, stamp in part.files.items() if name != "lens_surfaces.step"}
    with pytest.raises(ValidationError, match=r"lens_surfaces\.step: not a file"):
        Part(**content_of(part, files=without))
    with pytest.raises(ValidationError, match=r"lens\.obj: no such file"):
        Part(**content_of(part, files=part.files | {"lens.obj": stamp_of(b"")}))


@pytest.mark.parametrize("name", ["lens.step", "lens.stl", "lens.3mf", "lens_surfaces.step"])
def test_a_file_that_was_changed_is_named_and_a_missing_one_refused(part, tmp_path, name):
    part.write(tmp_path)
    spoilt = bytearray((tmp_path / name).read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    (tmp_path / name).write_bytes(spoilt)
    assert Part.read(tmp_path, lens=part.lens).altered == (name,) and part.altered == ()
    (tmp_path / name).unlink()
    with pytest.raises(InputError, match=r"(export\.json|lens\.\w+): .*run `lensforge export` again") as caught:
        Part.read(tmp_path, lens=part.lens)
    assert "\n" not in str(caught.value)


def test_the_plot_is_the_section(part):
    from matplotlib.figure import Figure

    axes = part.plot(Figure().add_subplot(), azimuth_deg=30.0)
    (body,) = axes.patches
    low, high = body.get_path().get_extents().get_points()
    assert (low[0], high[0]) == pytest.approx((-4.0, 4.0), abs=1e-9)  # the base is 8 mm wide
    assert low[1] == pytest.approx(-2.0)
    assert high[1] == pytest.approx(2.45, rel=0.02)
    assert axes.get_xlabel() == "across the axis at 30° (mm)"


# In a process of its own: where there is no renderer, OpenGL may end it.
_SHOW = """
import json
import sys
from pathlib import Path
from lensforge.cad.part import Part
from lensforge.scene.lens import load_lens
folder = Path(sys.argv[1])
part = Part.read(folder, lens=load_lens(folder / "lens.json"))
for cut in (False, True):
    plotter = part.show(cut=cut, off_screen=True)
    plotter.screenshot(folder / f"{cut}.png")
    print(json.dumps([*plotter.bounds, plotter.camera.position[1]]))
    plotter.close()
"""


@pytest.mark.nightly("a quarter of a minute")
def test_the_part_is_shown_off_screen_whole_and_cut(part, tmp_path):
    from matplotlib.image import imread

    part.write(tmp_path)
    part.lens.save(tmp_path / "lens.json")
    run = subprocess.run([sys.executable, "-c", _SHOW, str(tmp_path)], capture_output=True, encoding="utf-8")
    if run.returncode < 0:
        pytest.skip("no off-screen renderer here")
    assert run.returncode == 0, run.stderr
    bounds = [json.loads(line) for line in run.stdout.splitlines() if line.startswith("[")]
    assert bounds[0][:6] == pytest.approx([-4.0, 4.0, -4.0, 4.0, -2.0, bounds[0][5]], abs=1e-2)
    assert bounds[1][:6] == pytest.approx([-4.0, 4.0, -4.0, 0.0, -2.0, bounds[0][5]], abs=1e-2)
    assert bounds[1][6] > 0.0, "the camera looks into the cut"
    whole, cut = (imread(tmp_path / f"{name}.png") for name in (False, True))
    for picture in (whole, cut):
        assert np.ptp(picture[..., :3]) > 0.3, "not one colour all over"
    assert whole.shape == cut.shape
    assert np.abs(whole - cut).max() > 0.1


@pytest.mark.parametrize(
    ("changes", "asked"),
    [
        ({30: 1e-9}, [None]),  # at the limit
        ({30: 1.01e-9, 45: 1e-10}, [None, 45]),
        ({30: 2e-9, 45: 2e-9, 68: 1e-10}, [None, 45, 68]),
        (dict.fromkeys((30, 45, 68, 102, 153, 230), 2e-9), [None, 45, 68, 102, 153, 230]),  # a further one has too many
    ],
)
def test_a_step_that_does_not_read_back_is_made_again_of_more_nodes(part, monkeypatch, changes, asked):
    """Unless the nodes are stated: then its criterion says so."""
    made = []

    def build(lens, *, nodes, **_):
        made.append(nodes)
        count = nodes or 30
        counts = {"inner": 25 if nodes is None else count, "outer": count}
        content = content_of(part, nodes=counts, step_volume_change=changes[count])
        return Part(**{name: value for name, value in content.items() if name != "criteria"})  # judged anew

    monkeypatch.setattr("lensforge.cad.part_export.build_part", build)
    assert lf.build(part.lens).step_volume_change == changes[asked[-1] or 30]
    assert made == asked
    made.clear()
    assert lf.build(part.lens, nodes=30).step_volume_change == changes[30] and made == [30]
