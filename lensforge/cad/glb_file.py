"""glTF file (.glb) of the mesh, for pages and viewers: a node for the body, and below it one for each named face.

glTF is in metres, with y up. The vertices are those of STL and 3MF, in mm with z up and in single precision: the node
of the body turns and scales them. The same mesh gives the same bytes.
"""

from collections.abc import Sequence

import numpy as np

from lensforge.cad.mesh import BodyMesh
from lensforge.optics.pose import IN_PLACE, Pose

_M_PER_MM = 1e-3
_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_TO_GLTF = _Y_UP @ np.diag([_M_PER_MM, _M_PER_MM, _M_PER_MM, 1.0])
_GLASS = {"name": "lens", "baseColorFactor": (163, 191, 216, 153), "metallicFactor": 0.0, "roughnessFactor": 0.1}


def glb_bytes(mesh: BodyMesh, product: str, places: Sequence[Pose] = (IN_PLACE,)) -> bytes:
    """A glTF file of the body ``product`` at each of the ``places``, whose faces keep their names.

    Of several bodies each has its number behind its name, as do the nodes of its faces; all share their meshes.
    """
    import trimesh
    from trimesh.exchange.gltf import export_glb

    glass = trimesh.visual.material.PBRMaterial(**_GLASS, alphaMode="BLEND")
    scene = trimesh.Scene()
    for name in mesh.names:
        used, corners = np.unique(mesh.part(name), return_inverse=True)
        looks = trimesh.visual.TextureVisuals(material=glass)
        face = trimesh.Trimesh(mesh.vertices[used], corners.reshape(-1, 3), visual=looks, process=False)
        scene.geometry[name] = face
    for number, place in enumerate(places, 1):
        end = f" {number}" if len(places) > 1 else ""
        scene.graph.update(f"{product}{end}", "world", matrix=_TO_GLTF @ _matrix(place))
        for name in mesh.names:
            scene.graph.update(f"{name}{end}", f"{product}{end}", geometry=name)
    return bytes(export_glb(scene, include_normals=True))


def _matrix(place: Pose) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = place.rotation
    matrix[:3, 3] = place.origin_mm
    return matrix
