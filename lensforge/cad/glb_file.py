"""glTF file (.glb) of the mesh, for pages and viewers: a node for the body, and below it one for each named face.

glTF is in metres, with y up. The vertices are those of STL and 3MF, in mm with z up and in single precision: the node
of the body turns and scales them. The same mesh gives the same bytes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.mesh import BodyMesh
from lensforge.optics.pose import IN_PLACE, Pose

_M_PER_MM = 1e-3
_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_TO_GLTF = _Y_UP @ np.diag([_M_PER_MM, _M_PER_MM, _M_PER_MM, 1.0])
_GLASS = {"name": "lens", "baseColorFactor": (163, 191, 216, 153), "metallicFactor": 0.0, "roughnessFactor": 0.1}


@dataclass(frozen=True)
class Lines:
    """Broken lines of one ``colour`` (red, green, blue, 0 to 255), each by its points (mm)."""

    places_mm: Sequence[Float[np.ndarray, "_ 3"]]
    colour: tuple[int, int, int]


def glb_bytes(
    mesh: BodyMesh, product: str, places: Sequence[Pose] = (IN_PLACE,), lines: Mapping[str, Lines] | None = None
) -> bytes:
    """A glTF file of the body ``product`` at each of the ``places``, whose faces keep their names.

    Of several bodies each has its number behind its name, as do the nodes of its faces; all share their meshes.
    ``lines``: beside the body, by the names of their nodes.
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
    for name, drawn in (lines or {}).items():
        scene.geometry[name] = _path(drawn)
        scene.graph.update(name, "world", geometry=name, matrix=_TO_GLTF)
    return bytes(export_glb(scene, include_normals=True))


def _path(lines: Lines) -> Any:
    from trimesh.path import Path3D
    from trimesh.path.entities import Line

    ends = np.cumsum([len(places) for places in lines.places_mm])
    entities = [Line(np.arange(end - len(places), end)) for end, places in zip(ends, lines.places_mm, strict=True)]
    colours = np.tile([*lines.colour, 255], (len(entities), 1)).astype(np.uint8)
    return Path3D(entities, np.concatenate(list(lines.places_mm)), colors=colours, process=False)


def _matrix(place: Pose) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = place.rotation
    matrix[:3, 3] = place.origin_mm
    return matrix
