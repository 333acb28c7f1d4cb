"""A lens for total internal reflection from given faces: traced, its slopes, its files, and their proof; half a minute.

Four faces about the LED: the cap and the side of the cavity, the reflecting wall, and the exit. Where two bound the
same medium, the nearer one does; they meet in a crease. A silvered wall is one line more.
"""

from pathlib import Path

import numpy as np

import lensforge as lf
from lensforge.cad.body_export import build_body, prove
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.optics.media import FaceCoating, Media, Medium, Mirror
from lensforge.proof.proof_inputs import optical_of
from lensforge.proof.verification import passage_through
from lensforge.scene.body import Body, Face
from lensforge.scene.exit_rays import Sensitivities
from lensforge.sources.build_source import build_source
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace

REACH_MM, EVENTS = 16.0, 4  # farther than the rim of the exit, 14 mm from the LED
body = Body(
    (
        Face("cap", PlaneFace(REACH_MM, height_mm=4.0), CAVITY, BODY),
        Face("side", ConeFace(REACH_MM, radius_mm=3.2, slope=-0.05), CAVITY, BODY),
        Face("wall", ConicFace(REACH_MM, parameter_mm=5.0, eccentricity=1.0), BODY, OUTSIDE),
        Face("exit", PlaneFace(REACH_MM, height_mm=9.0), BODY, OUTSIDE),
    )
)
clear = Media(Medium(1.4936))
silvered = Media(Medium(1.4936), coatings=(FaceCoating("wall", OUTSIDE, Mirror(0.9)),))
rays = build_source(lf.SquareSource(side_mm=1.0), None).sample(2**16, seed=0)
for name, media in (("total reflection", clear), ("silvered wall", silvered)):
    lens = TracedLens.of_body(body, media, EVENTS, nodes_per_sigma=8.0)
    exits = lens.trace(rays)
    upwards = exits.left_lens & (exits.directions[:, 2] > np.cos(np.radians(15.0)))
    share = exits.flux[upwards].sum() / rays.flux.sum()
    error = np.sqrt(np.sum(exits.flux[upwards] ** 2)) / rays.flux.sum()  # of independent rays: an upper bound
    print(f"{name}: {100 * share:.2f} ± {100 * error:.2f} % of the flux within 15° of the axis, {len(rays)} rays")

traced, total = TracedBundle.of(lens.tables, lens.scene, rays), rays.flux.sum()
exits, nothing = traced.exits, np.zeros((len(rays), 3))
along = np.where(exits.left_lens[:, None], exits.flux[:, None] * [0.0, 0.0, 1.0], 0.0) / total
slopes = traced.gradients(Sensitivities(nothing, along), exits.directions[:, 2] / total, np.zeros(len(rays)))
change = dict(zip(traced.scene.names, slopes.sum(axis=(1, 2)).round(4).tolist(), strict=True))
print(f"flux times cosine to the axis, of 1: {(exits.flux * exits.directions[:, 2]).sum() / total:.4f}")
print(f"its change for 1 mm more radius of each face, by the adjoint: {change}")

built = build_body(body, lf.BaseSection(kind="cylinder", diameter_mm=16.0, height_mm=2.0))
step, stl, threemf = built.files("collimator")
proof = prove(built, step, stl, threemf)
forms = {name: f"{error.form_max_nm:.2g} nm" for name, error in proof.form.items()}
print(f"volume {proof.solid.volume_mm3:.3f} mm³, watertight: {proof.stl.watertight}, form: {forms}")
few = rays.take(slice(0, 300))
design, cast = lens.trace(few), passage_through(step, optical_of(body, EVENTS), silvered, few)
left = design.left_lens
print(f"STEP against design: {1e3 * np.linalg.norm(cast.points - design.points, axis=1)[left].max():.2g} µm at most")
for suffix, content in ((".step", step), (".stl", stl), (".3mf", threemf)):
    Path(f"collimator{suffix}").write_bytes(content)
