"""Files of the parts: STEP, STL and 3MF to print from; one shape gives the same bytes."""

from __future__ import annotations

import io
import re
import struct
import zipfile
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from build123d import Location, Part, export_step
from numpy.typing import NDArray

from assembly import Placed, Printed
from checks import mesh
from model import mesh_name, mesh_names

_ROUND = ("sole", "plate", "dome", "shade", "LED ball")  # parts whose outlines are seen as circles
_WHEN = (2026, 1, 1, 0, 0, 0)
_3MF = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"


def write_part(part: Printed, folder: Path) -> None:
    """Write a part's STEP, STL and 3MF, lying as it is printed.

    Args:
        part: The part.
        folder: Where.
    """
    step = folder / f"{part.name}.step"
    export_step(part.solid, str(step))
    text = step.read_text(encoding="utf-8")
    text = re.sub(
        r"FILE_NAME\([^;]*;", f"FILE_NAME('{part.name}','2026-01-01T00:00:00',(''),(''),'','','');", text, count=1
    )
    step.write_text(text, encoding="utf-8")
    triangles = mesh(part.solid, 0.05, 0.35)
    (folder / f"{part.name}.stl").write_bytes(stl(triangles))
    (folder / f"{part.name}.3mf").write_bytes(_three_mf(part.name, triangles))


def stl(triangles: NDArray[np.float64]) -> bytes:
    """Return a binary STL.

    Args:
        triangles: Shape (n, 3, 3).
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    rows = np.zeros(len(triangles), dtype=[("v", "<f4", (12,)), ("a", "<u2")])
    rows["v"] = np.concatenate([normals[:, None], triangles], 1).reshape(-1, 12)
    return b"robolamp".ljust(80) + struct.pack("<I", len(triangles)) + rows.tobytes()


def _three_mf(name: str, triangles: NDArray[np.float64]) -> bytes:
    points, index = np.unique(triangles.reshape(-1, 3).round(5), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    vertices = "".join(f'<vertex x="{x:.5g}" y="{y:.5g}" z="{z:.5g}"/>' for x, y, z in points)
    corners = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    model = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xml:lang="en-US" xmlns="{_3MF}">'
        f'<metadata name="Title">{name}</metadata><resources><object id="1" type="model"><mesh><vertices>{vertices}'
        f"</vertices><triangles>{corners}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>'
    )
    kinds = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
    )
    links = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        '<Relationship Target="/3D/3dmodel.model" Id="model" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
    )
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path, text in (("[Content_Types].xml", kinds), ("_rels/.rels", links), ("3D/3dmodel.model", model)):
            archive.writestr(zipfile.ZipInfo(path, _WHEN), text, zipfile.ZIP_DEFLATED, 9)
    return packed.getvalue()


def write_meshes(parts: Iterable[Placed], folder: Path) -> None:
    """Write the meshes of the lamp's model, as STL in metres, each in its link's frame.

    Args:
        parts: The lamp's parts.
        folder: Where.
    """
    found: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    for part in parts:
        if not part.ghost:
            fine, angle = (0.2, 0.35) if part.part in _ROUND else (0.25, 1.3)
            if part.part.startswith("screw"):
                fine, angle = 0.4, 1.6
            found[mesh_name(part.body, part.part, part.color)].append(mesh(part.solid, fine, angle))
    for name in mesh_names():
        (folder / f"{name}.stl").write_bytes(stl(np.concatenate(found[name]) / 1000.0))


def placed_mesh(part: Placed, place: Location, fine: float = 0.1) -> NDArray[np.float64]:
    """Return a part's triangles where its link is, shape (n, 3, 3) [mm].

    Args:
        part: The part.
        place: Where its link is.
        fine: Largest distance between surface and triangles [mm].
    """
    solid: Part = place * part.solid
    return mesh(solid, fine, 0.25)
