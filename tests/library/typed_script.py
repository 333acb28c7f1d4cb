"""A user's script under ``mypy --strict``: every verb and result has a real type (checked by ``make lint``)."""

from pathlib import Path
from typing import assert_type

import cadquery
import numpy as np
import pyvista
import trimesh
from matplotlib.axes import Axes

import lensforge as lf


def script(folder: Path) -> None:
    """Never run: its types are what is tested."""
    spec = lf.load_spec(folder / "pi.toml")
    assert_type(spec, lf.Spec)
    assert_type(spec.replace(name="other"), lf.Spec)
    assert_type(lf.SquareSource(side_mm=2.0), lf.SquareSource)
    shortest = lf.Spec(
        source=lf.SquareSource(side_mm=2),
        lens=lf.LensSection(material="PC"),
        constraints=lf.ConstraintsSection(max_radius_mm=14),
        target=lf.TextTarget(text="π", width_mm=90, distance_mm=150),
    )
    assert_type(shortest.constraints.cavity_height_mm, float)
    shortest.replace(lens=lf.TirSection(exit=lf.ExitFace(flat=True), cap=lf.FaceSection(offset_mm=2)))
    shortest.replace(lens=lf.ReflectorSection(cup=lf.CupSection(mirror=0.9)))
    assert_type(lf.TirSection(flange=lf.FlangeSection(diameter_mm=20, thickness_mm=1)), lf.TirSection)
    assert_type(lf.PartTolerances(faces={"outer": lf.FaceTolerances()}), lf.PartTolerances)
    assert_type(lf.RaySource(np.zeros((3, 7))), lf.RaySource)
    assert_type(lf.ArrayTarget(np.eye(4), width_mm=1.0, distance_mm=2.0, receiver_mm=3.0), lf.ArrayTarget)
    design = lf.design(spec, accuracy="draft", progress=lambda step: step.steps_done < 10)
    assert_type(design, lf.Design)
    assert_type(design.lens, lf.Lens)
    light = lf.evaluate(design.lens)
    assert_type(light.nmse, lf.Metric)
    assert_type(light.nmse.value, float)
    assert_type(light.nmse.standard_error, float | None)
    axes = light.plot()
    assert_type(axes, Axes)
    assert_type(light.plot(axes, which="raw_map"), Axes)
    part = lf.build(design.lens)
    assert_type(part, lf.Part)
    assert_type(part.step, bytes)
    assert_type(part.solid, cadquery.Solid)
    assert_type(part.mesh, trimesh.Trimesh)
    assert_type(part.show(cut=True, off_screen=True), pyvista.Plotter)
    assert_type(part.plot(azimuth_deg=30.0), Axes)
    assert_type(lf.check(part), lf.Check)
    assert_type(lf.verify(part, light), lf.Proof)
    assert_type(lf.stray_light(part), lf.StrayLight)
    assert_type(lf.sensitivity(design.lens), lf.Sensitivity)
    assert_type(lf.photometry(design.lens), lf.Photometry)
    assert_type(lf.compare(light, on="on.png"), lf.PhotoComparison)
    assert_type(lf.compare(design.lens, points="cloud.csv", surface="inner"), lf.SurfaceComparison)
    assert_type(lf.correct(design.lens, points="cloud.csv", surface="inner"), lf.Correction)
    assert_type(lf.sweep(spec, "constraints.max_radius_mm", [12.0, 14.0]), lf.Sweep)
    assert_type(lf.tradeoff(spec), lf.Tradeoff)
    assert_type(lf.rays("led.tm25ray"), lf.RayFileSummary | lf.PhotometricSummary)
    run = lf.run(spec, folder)
    assert_type(lf.handover(run), lf.Handover)
    assert_type(run, lf.Run)
    assert_type(run.light.efficiency.value, float)
    assert_type(run.verdict, lf.Verdict)
    assert_type(lf.load(folder), lf.Run)
