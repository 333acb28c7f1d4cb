# Not run by us: written after ansys-speos-core 0.9.2; nobody has run it with Speos yet.
"""The light of the exported part by Ansys Speos: pip install ansys-speos-core numpy, on a machine with its server.

The mesh is that of ``lens.obj`` with its normals. The result is an XMP file: its flux over that of the source is the
share of the light to compare.
"""

import sys

import numpy as np
from ansys.speos.core import Project
from ansys.speos.core.launcher import launch_local_speos_rpc_server
from ansys.speos.core.sensor import SensorIrradiance
from ansys.speos.core.simulation import SimulationDirect
from ansys.speos.core.source import SourceRayFile
from kit_figures import AXES, DETECTOR, HERE, KIT, window


def main() -> int:
    """Build the scene, compute, and print where the light is."""
    if DETECTOR["kind"] != "plane":
        sys.exit("this program has a sensor of irradiance; make one of intensity for a far field")
    project = Project(speos=launch_local_speos_rpc_server())
    body = project.create_root_part().create_body("lens")
    face = body.create_face("surface")
    face.vertices, face.normals, face.facets = mesh()
    project.root_part.commit()
    glass = project.create_optical_property("glass")
    optic = glass.set_volume_optic()
    optic.index = KIT["refractive_index"]
    optic.absorption = KIT["absorption_per_mm"]
    glass.set_surface_opticalpolished()
    glass.geometries = [body.geo_path]
    glass.commit()
    source = project.create_source("source", feature_type=SourceRayFile)
    source.ray_file_uri = HERE / "source.ray"
    source.set_flux_from_ray_file()
    source.set_spectrum_from_ray_file()
    source.commit()
    sensor = project.create_sensor("detector", feature_type=SensorIrradiance)
    size = sensor.set_dimensions()
    size.x_start, size.x_end, size.y_start, size.y_end = (0.5 * s * side for side in window() for s in (-1.0, 1.0))
    sensor.axis_system = [*DETECTOR["centre_mm"], *AXES.ravel().tolist()]
    sensor.set_type_radiometric()
    sensor.commit()
    simulation = project.create_simulation("direct", feature_type=SimulationDirect)
    simulation.sensor_paths = ["detector"]
    simulation.source_paths = ["source"]
    simulation.stop_condition_rays_number = len(np.load(HERE / "source.npy"))
    simulation.commit()
    print(*simulation.compute_CPU(), sep="\n")
    wanted = KIT["expected"]["efficiency"]["value"]
    print(f"expected: {wanted:.5f} of {KIT['source_w']:g} W, that is {wanted * KIT['source_w']:.5f} W on the sensor")
    return 0


def mesh():
    """Vertices, normals and facets of ``lens.obj``, each as one list."""
    rows = {"v": [], "vn": [], "f": []}
    for line in (HERE / "lens.obj").read_text(encoding="ascii").splitlines():
        kind, *cells = line.split()
        if kind in rows:
            rows[kind] += [int(cell.partition("/")[0]) - 1 if kind == "f" else float(cell) for cell in cells]
    return rows["v"], rows["vn"], rows["f"]


if __name__ == "__main__":
    sys.exit(main())
