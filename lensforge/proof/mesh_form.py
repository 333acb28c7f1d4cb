"""The form of the meshes in STL and 3MF files, facet by facet.

The corners of a facet lie on one face of the design, to rounding: that from which they are least off together. Its
middle lies within the chord error of flat facets.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import trimesh
from jaxtyping import Float, Int

from lensforge.proof.designed_body import ABOVE_MM, Designed, Levels
from lensforge.proof.file_form import Chords, DesignedFile, Farthest, FileForm, open_edges, rounding_um
from lensforge.proof.part_mesh import read_mesh
from lensforge.results.file_bounds import read_3mf
from lensforge.results.files import temporary_file

_FAR_MM = 1e6  # of two faces that do not meet no facet is a part

_Points = Float[np.ndarray, "n 3"]
_Triangles = Int[np.ndarray, "t 3"]


def mesh_forms(files: Sequence[DesignedFile], known: Mapping[bytes, trimesh.Trimesh]) -> dict[str, FileForm]:
    """Form of each STL and 3MF file by its name; ``known``: meshes of contents that have been read.

    A file with the facets of an earlier one that should hold the same body gets its form.
    """
    forms = dict[str, FileForm]()
    judged = list[tuple[DesignedFile, _Points, FileForm]]()
    for file in files:
        if file.is_step:
            continue
        vertices, triangles = _mesh_of(file, known)
        corners = vertices[triangles]
        alike = (
            form
            for other, other_corners, form in judged
            if file.is_judged_as(other) and _are_same(corners, other_corners)
        )
        same = next(alike, None)
        if same is None:
            forms[file.name] = mesh_form(file, vertices, triangles)
            judged.append((file, corners, forms[file.name]))
        else:
            edges = open_edges(triangles, len(vertices))
            forms[file.name] = same.changed(name=file.name, open_edges=edges)
    return forms


def _mesh_of(file: DesignedFile, known: Mapping[bytes, trimesh.Trimesh]) -> tuple[_Points, _Triangles]:
    if file.name.endswith(".3mf"):
        with temporary_file(file.content, file.name) as path:
            return read_3mf(path, file.name, "export it again")
    mesh = known[file.content] if file.content in known else read_mesh(file.content, file.name)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _are_same(first: Float[np.ndarray, "t 3 3"], second: Float[np.ndarray, "u 3 3"]) -> bool:
    """True for the same facets in the same order, up to the last digit of single precision."""
    return first.shape == second.shape and bool(
        1e3 * np.abs(first - second).max() <= rounding_um(second.reshape(-1, 3))
    )


def mesh_form(file: DesignedFile, vertices: _Points, triangles: _Triangles) -> FileForm:
    """Form of the mesh read from ``file``; neighbouring triangles share their vertices."""
    body = file.body
    chords = file.chords
    seen = Farthest()
    higher = (vertices[:, 2] > ABOVE_MM)[triangles].any(axis=1)
    for facets, faces in ((triangles[higher], body.above), (triangles[~higher], body.below)):
        if faces is not None and len(facets):
            _see_facets(seen, vertices, facets, faces, chords)
    return seen.form(file.name, body, file.limit_um + rounding_um(vertices), open_edges(triangles, len(vertices)))


def _see_facets(
    seen: Farthest, vertices: _Points, facets: _Triangles, faces: Sequence[Designed], chords: Chords
) -> None:
    """Assign each facet to the face from which its corners together are least off."""
    used = np.zeros(len(vertices), dtype=bool)
    used[facets] = True
    places = vertices[used]
    rows = (np.cumsum(used) - 1)[facets]
    away = [face.off_mm(places) for face in faces]
    middles = places[rows].mean(axis=1)
    mixed = any(isinstance(face, Levels) for face in faces)
    sums = []
    for face, (off, owners) in zip(faces, away, strict=True):
        on_one_face = np.ptp(owners[rows], axis=1) == 0
        # The corners of a facet within a round wall lie on it, too.
        beside = face.off_mm(middles)[0] if mixed else 0.0
        sums.append(np.where(on_one_face, off[rows].sum(axis=1) + beside, _FAR_MM))
    chosen = np.argmin(sums, axis=0)
    for number, (face, (off, owners)) in enumerate(zip(faces, away, strict=True)):
        on_face = chosen == number
        if not on_face.any():
            continue
        corners = rows[on_face].ravel()
        on_rims = np.where(places[corners, 2] <= ABOVE_MM, chords.rims_mm, 0.0)
        seen.see(face, np.maximum(off[corners] - on_rims, 0.0), places[corners], owners[corners])
        off_middle, owner = face.off_mm(middles[on_face], chords.of(face))
        seen.meet(face, owner)
        seen.see(face, np.maximum(off_middle - chords.of(face), 0.0), middles[on_face], owner)
