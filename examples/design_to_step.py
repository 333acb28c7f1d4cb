"""Shortest script from objects to a STEP file, its checks and a picture; at draft accuracy, about a minute."""

import lensforge as lf

target = lf.FlatTopTarget(width_mm=120.0, distance_mm=100.0, receiver_mm=200.0, uniform_mm=90.0)
lens = lf.LensSection(inner=lf.FaceSection(offset_mm=4.0), outer=lf.FaceSection(offset_mm=8.7))
limits = lf.ConstraintsSection(cavity_height_mm=0.8, cavity_radius_mm=1.2, min_thickness_mm=1.0, max_radius_mm=9.0)
spec = lf.Spec(source=lf.SquareSource(side_mm=1.0), target=target, lens=lens, constraints=limits)
design = lf.design(spec, accuracy="draft")
light, part = lf.evaluate(design.lens), lf.build(design.lens)
print(light, lf.check(part), lf.verify(part, light), sep="\n")
part.save("spot.step")
light.save("spot.png")
