"""Pictures of fibres: tubes and bodies by PyVista, off the screen; without it, lines in a side view by matplotlib."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from barchan.bodies.rigid import HalfSpace
from barchan.results.body_solids import camera
from barchan.results.fibre_scenes import FibreScene
from barchan.results.pictures import COLOUR_MAP
from barchan.results.solid_scenes import Pixels

Vector = NDArray[np.float64]

_VIEW = np.array([0.3, -1.0, 0.4])  # from the middle of the window to the eye
_THINNEST = 1.5e-3  # radius of a tube over the diagonal of the window, so that hair can be seen
_FEW = 300  # fibres up to which tubes are round; many are drawn as lines
_FACETS = 40  # across a body


def picture(scene: FibreScene, frame: int, pixels: Pixels) -> NDArray[np.uint8]:
    """RGB image of a frame by PyVista."""
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(pixels), lighting="three lights")
    plotter.set_background("white")
    _add_fibres(plotter, scene, frame)
    _add_bodies(plotter, scene, frame)
    eye, middle = camera(scene.window, pixels, float(plotter.camera.view_angle), _VIEW)
    plotter.camera_position = [eye, middle, (0.0, 0.0, 1.0)]
    plotter.reset_camera_clipping_range()
    image = np.asarray(plotter.screenshot(None, return_img=True))[:, :, :3]
    plotter.close()
    return image.copy()


def _add_fibres(plotter: Any, scene: FibreScene, frame: int) -> None:
    """Tubes of the fibres, or lines where there are many."""
    import pyvista

    nodes, starts = scene.nodes(frame), scene.starts
    cells = [np.r_[b - a, np.arange(a, b)] for a, b in pairwise(starts)]
    lines = pyvista.PolyData(nodes, lines=np.concatenate(cells))
    lines["value"] = scene.values(frame)
    style = {"scalars": "value", "cmap": COLOUR_MAP, "clim": scene.scale, "show_scalar_bar": False}
    if len(cells) > _FEW:
        plotter.add_mesh(lines, line_width=1.2, render_lines_as_tubes=True, **style)
        return
    lower, upper = scene.window
    radius = max(scene.radius, _THINNEST * float(np.linalg.norm(upper - lower)))
    plotter.add_mesh(lines.tube(radius=radius, n_sides=8), smooth_shading=True, **style)


def _add_bodies(plotter: Any, scene: FibreScene, frame: int) -> None:
    """Bodies by their facets, with a line round them that shows how they turn; planes as ground."""
    import pyvista

    lower, upper = scene.window
    middle, size = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
    for number, body in enumerate(scene.bodies):
        place, turn = scene.pose(number, float(scene.times[frame]))
        if isinstance(body.shape, HalfSpace):
            normal = turn @ body.shape.normal
            foot = middle - normal * float(normal @ (middle - place) - body.shape.offset)
            plotter.add_mesh(
                pyvista.Plane(center=foot, direction=normal, i_size=size, j_size=size), color="wheat"
            )
            continue
        low, high = body.shape.bounds()
        facets = body.shape.facets(float(np.max(high - low)) / _FACETS, low, high) @ turn.T + place
        count = len(facets)
        faces = np.concatenate([np.full((count, 1), 3), np.arange(3 * count).reshape(count, 3)], axis=1)
        mesh = pyvista.PolyData(facets.reshape(-1, 3), faces.ravel())
        # a half of another grey tells how the body is turned
        local = (np.mean(facets, axis=1) - place) @ turn
        mesh.cell_data["half"] = (local[:, 0] > 0.5 * (low + high)[0]).astype(float)
        plotter.add_mesh(mesh, scalars="half", cmap=["#c8bfb0", "#a89c88"], show_scalar_bar=False)


def side_view(scene: FibreScene, frame: int, pixels: Pixels) -> NDArray[np.uint8]:
    """RGB image of a frame by matplotlib: centre lines and outlines of bodies in the plane x, z."""
    figure = Figure(figsize=(pixels[0] / 100.0, pixels[1] / 100.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.add_axes((0.02, 0.02, 0.96, 0.94))
    lower, upper = scene.window
    axis.set(xlim=(lower[0], upper[0]), ylim=(lower[2], upper[2]), aspect="equal")
    axis.set_axis_off()
    for number, body in enumerate(scene.bodies):
        place, turn = scene.pose(number, float(scene.times[frame]))
        least = np.where(np.isfinite(body.shape.bounds()[0]), body.shape.bounds()[0], lower - place)
        most = np.where(np.isfinite(body.shape.bounds()[1]), body.shape.bounds()[1], upper - place)
        facets = body.shape.facets(float(np.max(most - least)) / 16, least, most) @ turn.T + place
        axis.add_collection(PolyCollection(list(facets[:, :, [0, 2]]), facecolors="0.8", edgecolors="0.8"))
    nodes, values = scene.nodes(frame), scene.values(frame)
    inside = np.ones(len(nodes) - 1, dtype=bool)
    inside[scene.starts[1:-1] - 1] = False
    pieces = np.stack([nodes[:-1], nodes[1:]], axis=1)[inside][:, :, [0, 2]]
    axis.add_collection(
        LineCollection(list(pieces), array=values[:-1][inside], cmap=COLOUR_MAP, norm=Normalize(*scene.scale), linewidths=0.8)
    )  # fmt: skip
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
