"""What the oracles start from: rays as their source emits them, tables with their light, files with the tables."""

from collections.abc import Callable

import numpy as np
import oracle_far
import pytest
from crooked import NAMES, Case, led_rays
from oracle_light import evaluation, kinds_in
from page_colour import efficacy, flux_and_efficacy, spectrum
from page_scene import page_tracer, receivers_of, target_light, turn_of

OF_LEDS = {"near": ("near",), "far": ("near", "far")}
POWER = {"roads": 1.3}


def own_rays(source, call):
    """Rays of a call in the coordinates of the source: positions, directions, flux, wavelengths."""
    turn = turn_of(source["tilt_deg"], source["rotate_z_deg"])
    p, d, flux = (np.concatenate([part[k] for part in call]) for k in (2, 3, 4))
    nm = None if call[0][5] is None else np.concatenate([part[5] for part in call])
    return (p - source["position_mm"]) @ turn, d @ turn, flux, nm


@pytest.mark.parametrize("name", [name for name in NAMES if name != "leds"])
def test_rays_of_a_planar_source(case: Callable[[str], Case], name: str) -> None:
    """Places and directions by their moments, within five standard errors of independent rays; flux and colours."""
    scene = case(name)
    source = scene.lens["spec"]["source"]
    watts = flux_and_efficacy(source, scene.files)[0]
    for call in scene.rays["evaluate"][: kinds_in(scene)]:
        p, d, _, nm = own_rays(source, call)
        assert abs(p[:, 2]).max() < 1e-12 and d[:, 2].min() >= 0
        for _, factor, _, _, flux, _ in call:
            assert (factor * flux).sum() == pytest.approx(watts, rel=1e-4)
        power = POWER.get(name, 1.0)
        count = len(p)
        for values, mean, variance in (
            (d[:, 2] ** (power + 1), 0.5, 1 / 12), (d[:, 0], 0.0, 0.25), (d[:, 1], 0.0, 0.25),
            (d[:, 0] * d[:, 1], 0.0, 0.05), (d[:, 0] ** 2 - d[:, 1] ** 2, 0.0, 0.2),
        ):  # fmt: skip
            assert abs(values.mean() - mean) < 5 * np.sqrt(variance / count)
        if name == "chips":
            chips_are_right(source, p, nm, count)
            continue
        for k, side in ((0, source["width_mm"]), (1, source["height_mm"])):
            assert abs(p[:, k]).max() <= side / 2 and abs(p[:, k]).max() > 0.49 * side
            assert abs(p[:, k].mean()) < 5 * side / np.sqrt(12 * count)
            assert (p[:, k] ** 2).mean() == pytest.approx(side**2 / 12, rel=5 / np.sqrt(count))
        if nm is not None:
            at, density = spectrum(source["spectrum"])
            mean = (at * density).sum() / density.sum()
            assert nm.mean() == pytest.approx(mean, abs=5 * nm.std() / np.sqrt(count))


def chips_are_right(source, p, nm, count) -> None:
    """The share of each by its flux, and its own wavelengths."""
    watts = np.array([chip["flux_lm"] / efficacy(chip["spectrum"]) for chip in source["chips"]])
    for chip, share in zip(source["chips"], watts / watts.sum(), strict=True):
        x, y = p[:, 0] - chip["x_mm"], p[:, 1] - chip["y_mm"]
        on = (abs(x) <= chip["width_mm"] / 2 + 1e-9) & (abs(y) <= chip["height_mm"] / 2 + 1e-9)
        assert on.mean() == pytest.approx(share, abs=5 * np.sqrt(share / count))
        at, density = spectrum(chip["spectrum"])
        mean = (at * density).sum() / density.sum()
        assert nm[on].mean() == pytest.approx(mean, abs=5 * nm[on].std() / np.sqrt(on.sum()) + 0.3)
        assert (x[on] ** 2).mean() == pytest.approx(chip["width_mm"] ** 2 / 12, rel=0.1)


def test_rays_of_files_are_those_of_the_files(case: Callable[[str], Case]) -> None:
    """Each ray that judges is one of its LED's; three tenths of all, none twice, none that the search has used."""
    scene = case("leds")
    calls = iter(scene.rays["evaluate"])
    for led in scene.lens["spec"]["sources"]:
        source = led["source"]
        rows = []
        parts = []
        for stem, part in zip(OF_LEDS[led["name"]], source.get("files") or [{"flux_w": None}], strict=True):
            p, d, flux = (rays.astype(float) for rays in led_rays(stem))
            rows.append((p, d / np.linalg.norm(d, axis=1)[:, None]))
            parts.append(flux / flux.sum() * (part["flux_w"] or 0.4))
        p, d = (np.concatenate([row[k] for row in rows]) for k in (0, 1))
        p, d = page_tracer.into_own_frame(source, p, d)
        known = {tuple(np.round(row, 4)): k for k, row in enumerate(np.column_stack([p, d]))}
        used = []
        for call in (next(calls), next(calls)):
            at, on, flux, _ = own_rays(source, call)
            numbers = [known[tuple(np.round(row, 4) + 0.0)] for row in np.column_stack([at, on])]
            used.append(numbers)
            stated = np.concatenate(parts)[numbers]
            assert flux / flux.sum() == pytest.approx(stated / stated.sum(), rel=1e-5)
            for _, factor, _, _, own_flux, _ in call:
                assert (factor * own_flux).sum() == pytest.approx(sum(part.sum() for part in parts), rel=1e-5)
        judged, searched = map(set, used)
        assert len(used[0]) == len(judged) == round(0.3 * len(p)) and not judged & searched
        assert judged | searched == set(range(len(p)))


@pytest.mark.parametrize("name", NAMES)
def test_pictures_of_each_receiver(case: Callable[[str], Case], name: str) -> None:
    """Light, and target scaled to it, in W/m² or W/sr of all lamps."""
    scene = case(name)
    arrays = np.load(scene.folder / "evaluate.npz")
    lamps = len((scene.lens["spec"]["lamps"] or {}).get("places_mm", [0]))
    for number, (receiver, images) in enumerate(
        zip(receivers_of(scene.lens["spec"]), evaluation(scene)[1], strict=True)
    ):
        light = images.mean(axis=0) * lamps / receiver.measure
        stored = arrays[f"receivers.{number}.map"]
        assert abs(stored - light).sum() < 5e-3 * light.sum()
        target = target_light(receiver)[0] * light.sum()
        assert abs(arrays[f"receivers.{number}.target_map"] - target).max() < 1e-4 * target.max()


@pytest.mark.parametrize("name", NAMES)
def test_table_of_the_far_field_has_the_light_of_the_rays(case: Callable[[str], Case], name: str) -> None:
    """Flux, and means of products of the components of the direction."""
    for scene in case(name).of_leds():
        tables = oracle_far.once(scene, oracle_far.Tables)
        samples = oracle_far.once(scene, oracle_far.leaving)
        watts, source_lm, _ = oracle_far.lumens(scene)
        flux = sum(sample[0] for sample in samples) / 16 * source_lm / watts
        turned = oracle_far.together(scene) > 1  # by angles that the moments do not know
        fine = np.radians(np.linspace(0, 90, 721)[:-1] + 1 / 16)
        at = np.radians(np.arange(0, 360, 2.0) + 1)
        down, azimuth = np.meshgrid(fine, at)
        values = oracle_far.bilinear(tables.azimuth, tables.gamma, tables.whole, np.degrees(azimuth), np.degrees(down))
        light = values * np.sin(down) * (fine[1] - fine[0]) * np.radians(2)
        assert light.sum() == pytest.approx(flux, rel=4e-3 if scene.lens["spec"]["lamps"] else 1e-3)
        u = np.sin(down) * np.cos(azimuth), np.sin(down) * np.sin(azimuth), np.cos(down)
        d, weight = (np.concatenate([sample[k] for sample in samples]) for k in (1, 2))
        ways = ((2,), (2, 2)) if turned else ((0,), (1,), (2,), (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
        for way in ways:
            table = np.prod([u[k] for k in way], axis=0)
            rays = np.prod([d[:, k] for k in way], axis=0)
            mean = (weight * rays).sum() / weight.sum()
            assert (light * table).sum() / light.sum() == pytest.approx(mean, abs=max(8e-3, 0.25 / len(d) ** 0.5)), way


@pytest.mark.parametrize("name", NAMES)
def test_files_of_the_far_field_hold_its_table(case: Callable[[str], Case], name: str) -> None:
    """By readers of a few lines each; the rays of the TM-25 file leave a sphere about the lens."""
    for scene in case(name).of_leds():
        tables = oracle_far.once(scene, oracle_far.Tables)
        (_, source_lm, known) = oracle_far.lumens(scene)
        arrays = np.load(scene.folder / "photometry.npz")
        c = arrays["c_deg"]
        gamma = arrays["gamma_deg"]
        candela = arrays["candela"]
        turned = oracle_far.bilinear(
            tables.azimuth, tables.gamma, tables.whole, *np.meshgrid(-c % 360, gamma, indexing="ij")
        )
        assert c[-1] == 360 and abs(candela - turned).max() < 1e-4 * candela.max()
        ies_c, ies_gamma, ies_cd, head = oracle_far.ies((scene.folder / "lens.ies").read_text(encoding="utf-8"))
        ldt_c, ldt_gamma, ldt_cd, more = oracle_far.ldt((scene.folder / "lens.ldt").read_text(encoding="latin-1"))
        tm_c, tm_gamma, tm_cd = oracle_far.tm33((scene.folder / "lens.iesxml").read_text(encoding="utf-8"))
        for at, down, values in ((ies_c, ies_gamma, ies_cd), (ldt_c, ldt_gamma, ldt_cd), (tm_c, tm_gamma, tm_cd)):
            assert down[: len(gamma)] == pytest.approx(gamma)
            assert at == pytest.approx(c[: len(at)])
            assert values[:, : len(gamma)] == pytest.approx(candela[: len(at)], abs=2e-6 * candela.max())
        assert head["lamps"] * abs(head["lumens"]) == pytest.approx(source_lm, rel=1e-4)
        assert float(more["lumens"]) == pytest.approx(source_lm, rel=1e-4)
        content = (scene.folder / "lens.tm25ray").read_bytes()
        count = scene.json("photometry")["files"]["tm25ray"]["rays"]
        rows = np.frombuffer(content[-28 * count :], dtype="<f4").reshape(count, 7).astype(float)
        far = np.linalg.norm(rows[:, :3], axis=1)
        assert far.max() - far.min() < 1e-4 * far.max() and (rows[:, 5] > 0).all()
        assert np.linalg.norm(rows[:, 3:6], axis=1) == pytest.approx(1.0, abs=1e-5)
        assert rows[:, 6].sum() == pytest.approx(scene.json("photometry")["exit_w"]["value"], rel=1e-5)
        assert known == (not scene.json("photometry")["per_1000_lm"])
