"""Pictures of a cloth: shaded surfaces by PyVista, off the screen; without it, shaded triangles by matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from barchan.bodies.rigid import HalfSpace
from barchan.results.cloth_scenes import ClothScene
from barchan.results.pictures import COLOUR_MAP
from barchan.results.solid_scenes import Pixels

Vector = NDArray[np.float64]

_VIEW = np.array([0.55, -1.0, 0.45])  # from the middle of the window to the eye
_LIGHT = np.array([0.4, -0.6, 0.7]) / np.linalg.norm([0.4, -0.6, 0.7])
_DISTANCE = 0.95  # to the eye, over the distance from which a ball about the window is just seen
_FACETS = 40  # across a body
_BODY, _GROUND = (0.82, 0.82, 0.84), "wheat"


def picture(scene: ClothScene, frame: int, pixels: Pixels) -> NDArray[np.uint8]:
    """RGB image of a frame by PyVista."""
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(pixels), lighting="three lights")
    plotter.set_background("white")
    cloth = _surface(scene.vertices(frame), scene.triangles)
    cloth["value"] = scene.values(frame)
    plotter.add_mesh(
        cloth, scalars="value", cmap=COLOUR_MAP, clim=scene.scale, show_scalar_bar=False, smooth_shading=True
    )
    for number, body in enumerate(scene.bodies):
        place, turn = scene.pose(number, float(scene.times[frame]))
        if isinstance(body.shape, HalfSpace):
            _add_ground(plotter, scene, turn @ body.shape.normal, place, body.shape.offset)
            continue
        corners = _facets(body.shape, scene.sunken(number, frame)) @ turn.T + place
        solid = _surface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        plotter.add_mesh(solid.clean(), color=_BODY, smooth_shading=True, split_sharp_edges=True)
        for line in _meridians(corners, place, turn):
            plotter.add_mesh(line, color="dimgrey", line_width=2)
    lower, upper = scene.window
    middle, half = 0.5 * (lower + upper), 0.5 * float(np.linalg.norm(upper - lower))
    away = _DISTANCE * half / np.sin(np.radians(0.5 * float(plotter.camera.view_angle)))
    plotter.camera_position = [middle + away * _VIEW / np.linalg.norm(_VIEW), middle, (0.0, 0.0, 1.0)]
    plotter.reset_camera_clipping_range()
    image = np.asarray(plotter.screenshot(None, return_img=True))[:, :, :3]
    plotter.close()
    return image.copy()


def _surface(points: Vector, triangles: NDArray[np.int64]) -> Any:
    import pyvista

    faces = np.column_stack([np.full(len(triangles), 3), triangles])
    return pyvista.PolyData(points, faces.ravel())


def _meridians(corners: Vector, place: Vector, turn: Vector) -> list[Any]:
    """Two lines round a body in planes through its own vertical axis, which show how it turns."""
    solid = _surface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return [solid.slice(normal=turn[:, axis], origin=place) for axis in (0, 1)]


def _add_ground(plotter: Any, scene: ClothScene, normal: Vector, place: Vector, offset: float) -> None:
    import pyvista

    if normal[2] < 0.5:
        return
    lower, upper = scene.window
    middle = 0.5 * (lower + upper)
    middle = middle - normal * float(normal @ (middle - place) - offset)
    side = 1.2 * float(np.linalg.norm((upper - lower)[:2]))
    plotter.add_mesh(pyvista.Plane(center=middle, direction=normal, i_size=side, j_size=side), color=_GROUND)


def _facets(shape: Any, depth: float) -> Vector:
    """Facets (f, 3, 3) of a shape in its frame, drawn in by `depth` [m]: flat triangles of cloth cut curved surfaces."""
    lower, upper = shape.bounds()
    facets = np.asarray(shape.facets(float(np.max(upper - lower)) / _FACETS, lower, upper))
    points = facets.reshape(-1, 3)
    return np.asarray(points - depth * shape.normals(points)).reshape(facets.shape)


def shaded_view(scene: ClothScene, frame: int, pixels: Pixels) -> NDArray[np.uint8]:
    """RGB image of a frame by matplotlib: triangles of cloth and bodies, the farthest first, shaded; no planes."""
    shades = colormaps[COLOUR_MAP]
    vertices, triangles = scene.vertices(frame), scene.triangles
    norm = Normalize(*scene.scale)
    parts = [(vertices[triangles], shades(norm(scene.values(frame)[triangles].mean(axis=1)))[:, :3])]
    for number, body in enumerate(scene.bodies):
        if isinstance(body.shape, HalfSpace):
            continue
        place, turn = scene.pose(number, float(scene.times[frame]))
        corners = _facets(body.shape, scene.sunken(number, frame)) @ turn.T + place
        parts.append((corners, np.tile(_BODY, (len(corners), 1))))
    corners, colours = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    back = _VIEW / np.linalg.norm(_VIEW)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    plane = np.stack([right, np.cross(back, right)], axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    light = 0.35 + 0.65 * np.abs(normals @ _LIGHT)
    order = np.argsort(corners.mean(axis=1) @ back)
    lower, upper = scene.window
    middle, half = 0.5 * (lower + upper) @ plane, 0.5 * float(np.linalg.norm(upper - lower))
    figure = Figure(figsize=(pixels[0] / 100, pixels[1] / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set_axis_off()
    axis.set(
        xlim=middle[0] + np.array([-half, half]), ylim=middle[1] + np.array([-half, half]), aspect="equal"
    )
    shaded = np.clip(colours * light[:, None], 0.0, 1.0)[order]
    axis.add_collection(
        PolyCollection(corners[order] @ plane, facecolors=shaded, edgecolors=shaded, linewidths=0.3)
    )
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
