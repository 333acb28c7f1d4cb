"""Bodies of a spec: their places and materials, what does not nest, and what they do not go with."""

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.scene.lens_at_temperature import at_temperature
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, load_spec, parse_spec
from lensforge.surfaces import asphere

COVER = {
    "name": "cover", "material": "PC", "centre_mm": [0.0, 3.0, -2.0], "tilt_deg": [10.0, 0.0],
    "inner": {"fixed": {"kind": "sphere", "radius_mm": 20.0}},
    "outer": {"fixed": {"kind": "sphere", "radius_mm": 22.0}},
}  # fmt: skip


def spec_with(*bodies: dict, **more) -> Spec:
    content = {
        "source": {"kind": "square", "side_mm": 1.0},
        "constraints": {"max_radius_mm": 8.0},
        "target": {"kind": "rectangle", "width_mm": 100.0, "height_mm": 100.0, "distance_mm": 150.0,
                   "receiver_mm": 150.0},
        "bodies": list(bodies),
    }  # fmt: skip
    return parse_spec(content | more, "test")


def sphere(radius_mm: float, **fields) -> dict:
    return {"fixed": {"kind": "sphere", "radius_mm": radius_mm, **fields}}


def test_a_body_stands_where_it_is_put() -> None:
    (body,) = spec_with(COVER).media.bodies
    apex = body.pose.points(np.array([[0.0, 0.0, 22.0]]))[0]
    tilt = np.radians(10.0)
    assert apex == pytest.approx([0.0, 3.0 - 22.0 * np.sin(tilt), -2.0 + 22.0 * np.cos(tilt)])
    assert body.pose.to_local_points(apex[None])[0] == pytest.approx([0.0, 0.0, 22.0])
    assert body.medium.refractive_index == pytest.approx(1.585, abs=2e-3)
    assert body.medium.material is not None, "dispersive"


def test_a_spec_with_bodies_is_saved_and_read(tmp_path) -> None:
    spec = spec_with(COVER, {**COVER, "name": "next", "inner": sphere(30.0), "outer": sphere(33.0)})
    spec.save(tmp_path / "spec.toml")
    again = load_spec(tmp_path / "spec.toml")
    assert again.bodies == spec.bodies and again.media == spec.media


def test_a_facet_of_the_rms_slope_turns_light_by_the_angle_that_the_spec_gives_its_face() -> None:
    """Each face by its indices before and behind it, by Snell's law: of the lens in water, and of a body there."""
    before = {"inner": 1.1, "outer": 1.5}, {"inner": 1.33, "outer": 1.7}
    behind = {"inner": 1.5, "outer": 1.33}, {"inner": 1.7, "outer": 1.33}
    sigma_deg = {"inner": 2.0, "outer": 5.0}
    rough = {name: {"scatter": {"kind": "gaussian", "sigma_deg": angle}} for name, angle in sigma_deg.items()}
    shell = {name: COVER[name] | rough[name] for name in rough}
    lens = {"cavity_index": 1.1, "outside_index": 1.33, "refractive_index": 1.5, **rough}
    cover = {key: value for key, value in COVER.items() if key != "material"} | shell | {"refractive_index": 1.7}
    media = spec_with(cover, lens=lens).media
    (body,) = media.bodies
    for scatter, first, second in zip((media.scatter, body.scatter), before, behind, strict=True):
        for face in scatter:
            tilt = np.arctan(face.model.slope)
            turned = np.arcsin(first[face.face] / second[face.face] * np.sin(tilt)) - tilt
            assert abs(turned) == pytest.approx(np.radians(sigma_deg[face.face]), rel=1e-12), face.face
        assert [face.face for face in scatter] == ["inner", "outer"]


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        ([{**COVER, "outer": sphere(19.0)}], "inner and outer of body 'cover' cross: -1 mm"),
        ([{**COVER, "inner": sphere(9.0)}], "the lens may reach .* mm out of its cavity"),
        ([COVER, COVER], "two have the name 'cover'"),
        ([COVER, {**COVER, "name": "next", "inner": sphere(21.0)}], "body 'next': body 'cover' may reach 1 mm out"),
        ([{**COVER, "material": "jelly"}], "material: 'jelly' is unknown; one of .*PMMA.*or give refractive_index"),
        ([{**COVER, "material": "PC", "abbe_number": 30.0}], "abbe_number needs refractive_index"),
        (
            [{key: value for key, value in COVER.items() if key != "outer"}],
            "outer: missing: face towards the receivers",
        ),
    ],
)
def test_what_is_no_shell_about_the_lens_is_refused(bodies, message) -> None:
    with pytest.raises(InputError, match=message):
        spec_with(*bodies)


def test_the_cover_glass_stands_in_front_of_all_bodies_and_lamps_beside_each_other() -> None:
    """The cover reaches 22 mm from its centre at (0, 3, -2) mm, 20 mm above z = 0 and 3 mm + 22 cos 10 deg beside."""

    def glass(distance_mm: float) -> dict:
        return {"lens": {"cover_glass": {"refractive_index": 1.5, "thickness_mm": 2.0, "distance_mm": distance_mm}}}

    def lamps(pitch_mm: float) -> dict:
        return {"lamps": {"kind": "grid", "columns": 2, "rows": 2, "pitch_mm": pitch_mm}}

    for more in (glass(20.01), lamps(49.4), {"optimise": {"robust": True}}):
        assert spec_with(COVER, **more).media.bodies
    for more, message in (
        (glass(19.9), "body 'cover' reaches z = 20 mm"),
        (lamps(49.0), "body 'cover' of each reaches"),
    ):
        with pytest.raises(InputError, match=message):
            spec_with(COVER, **more)


def test_a_receiver_within_the_body_of_any_lamp_is_refused() -> None:
    target = {"kind": "rectangle", "width_mm": 4.0, "height_mm": 4.0, "distance_mm": 25.0, "receiver_mm": 8.0}
    places = {"kind": "table", "places_mm": [[0.0, 0.0, 0.0], [60.0, 0.0, 12.0], [-60.0, 0.0, 0.0]]}
    receivers_of(spec_with(COVER, target=target, lamps=places), 16)
    places["places_mm"][0] = [0.0, 0.0, 12.0]
    with pytest.raises(InputError, match="body 'cover': a receiver lies within it"):
        receivers_of(spec_with(COVER, target=target, lamps=places), 16)


def test_a_receiver_within_a_body_is_refused() -> None:
    target = {"kind": "rectangle", "width_mm": 4.0, "height_mm": 4.0, "distance_mm": 15.0, "receiver_mm": 8.0}
    with pytest.raises(InputError, match="body 'cover': a receiver lies within it"):
        receivers_of(spec_with(COVER, target=target), 16)


@pytest.mark.parametrize(
    ("changes", "symmetry"),
    [({"centre_mm": [0.0, 0.0, -2.0], "tilt_deg": [0.0, 0.0]}, "square"), ({}, "mirror_x"),
     ({"tilt_deg": [0.0, 0.0]}, "mirror_x"),
     ({"tilt_deg": [10.0, 4.0]}, "none"), ({"centre_mm": [1.0, 0.0, -2.0], "tilt_deg": [0.0, 8.0]}, "mirror_y")],
)  # fmt: skip
def test_the_lens_has_no_larger_symmetry_than_the_bodies(changes, symmetry) -> None:
    spec = spec_with({**COVER, **changes})
    assert settled_symmetry(spec, build_source(spec.source)).lens.symmetry == symmetry


def test_the_lens_at_a_temperature_keeps_its_bodies() -> None:
    spec = spec_with(COVER, lens={"material": "PMMA", "levels": [9], "index_per_k": -1e-4, "expansion_per_k": 7e-5})
    lens = Lens.double(asphere.sphere(3.0), asphere.sphere(8.0), spec, 0, "draft")
    assert at_temperature(lens, 60.0).media.bodies == spec.media.bodies
