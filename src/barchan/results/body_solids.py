"""Pictures of bodies in space by PyVista, off the screen: frames side by side, contact forces, an animation.

PyVista is an extra (`pip install "barchan[viz]"`); without it a warning says that there are no such pictures.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from barchan.bodies.rigid import HalfSpace, Sphere
from barchan.results import solid_scenes
from barchan.results.body_pictures import FORCE_MAP
from barchan.results.body_scenes import BodyScene, Window
from barchan.results.figures import new_figure, save_figure
from barchan.results.pictures import COLOUR_MAP
from barchan.results.view import spread_frames

Vector = NDArray[np.float64]

_PIXELS = (900, 720)
_VIEW = np.array([0.9, -1.6, 0.75])  # from what is looked at to the eye
_ROOM, _AIMS = 1.05, 3  # of the least distance of the eye; turns in which the window is brought to the middle
_FACETS = 30  # across a body that is not a sphere
_DRIVEN = "lightgrey"
_THINNEST, _WIDEST = 0.05, 0.45  # radii of force lines, in the mean radius of bodies
_SLIMMEST = 0.03  # of the window, in place of that radius where bodies are few and large


def draw_strip(path: Path, scene: BodyScene, title: str) -> None:
    """Up to four frames, evenly spread in time."""
    if not _has_pyvista():
        return
    frames = spread_frames(scene.results, 4, float(scene.times[-1]))
    columns = min(2, len(frames))
    rows = -(-len(frames) // columns)
    figure = new_figure(columns * 4.6 + 1.4, rows * 3.9 + 0.7)
    axes: Any = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, frame in zip(axes, frames, strict=False):
        axis.imshow(picture(scene, frame, _PIXELS, scene.window))
        axis.set_title(f"t = {scene.times[frame]:.3g} s", fontsize=9, loc="left")
    shown = ScalarMappable(Normalize(*scene.scale), COLOUR_MAP)
    figure.colorbar(shown, ax=list(axes), label=scene.label, extend="max", shrink=0.8, pad=0.01)
    figure.suptitle(title, fontsize=11)
    save_figure(figure, path)


def draw_forces(path: Path, scene: BodyScene, title: str) -> None:
    """Force chains of the last frame: tubes through the contacts, as wide and as dark as the force is large."""
    if not _has_pyvista():
        return
    frame = scene.results.frames - 1
    figure = new_figure(7.6, 5.6)
    axis: Any = figure.subplots()
    axis.set_axis_off()
    axis.imshow(picture(scene, frame, _PIXELS, scene.window_of([frame]), with_forces=True))
    largest = max(float(np.max(scene.forces(frame).sizes, initial=0.0)), 1e-300)
    figure.colorbar(
        ScalarMappable(Normalize(0.0, largest), FORCE_MAP), ax=axis, label="contact force (N)", shrink=0.8
    )
    axis.set_title(f"{title}\nforces, t = {scene.times[frame]:.3g} s", fontsize=10, loc="left")
    save_figure(figure, path)


def draw_animation(path: Path, scene: BodyScene, title: str) -> None:
    """An endless GIF of the run, at most 3 MB."""
    if _has_pyvista():
        solid_scenes.draw_animation(path, scene, title, _whole)


def _whole(scene: BodyScene, frame: int, pixels: tuple[int, int]) -> NDArray[np.uint8]:
    return picture(scene, frame, pixels, scene.window)


def picture(
    scene: BodyScene, frame: int, pixels: tuple[int, int], window: Window, with_forces: bool = False
) -> NDArray[np.uint8]:
    """RGB image of what a window shows of a frame; `with_forces` the bodies are glass and the forces are tubes."""
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(pixels), lighting="three lights")
    plotter.set_background("white")
    for free in (True, False):
        _add_spheres(plotter, scene, frame, free, with_forces)
    _add_solids(plotter, scene, frame, window, with_forces)
    if with_forces:
        _add_forces(plotter, scene, frame)
    eye, middle = camera(window, pixels, float(plotter.camera.view_angle))
    plotter.camera_position = [eye, middle, (0.0, 0.0, 1.0)]
    image = np.asarray(plotter.screenshot(None, return_img=True))[:, :, :3]
    plotter.close()
    return image.copy()


def camera(
    window: Window, pixels: tuple[int, int], angle: float, view: Vector = _VIEW
) -> tuple[Vector, Vector]:
    """Eye and the point it looks at [m], near: all corners of the window are just seen in a view `angle` degrees high.

    view : (3,) from what is looked at to the eye.
    """
    lower, upper = window
    corners = np.array(
        [[(lower, upper)[k][axis] for axis, k in enumerate(ends)] for ends in np.ndindex(2, 2, 2)]
    )
    back = view / np.linalg.norm(view)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    middle = 0.5 * (lower + upper)
    slopes = np.tan(np.radians(0.5 * angle)) * np.array([pixels[0] / pixels[1], 1.0])
    axes = np.stack([right, np.cross(back, right)], axis=1)
    distance = 0.0
    for _ in range(_AIMS):
        across, depth = (corners - middle) @ axes, (corners - middle) @ back
        distance = float(np.max(np.abs(across) / slopes + depth[:, None]))
        seen = across / (distance - depth)[:, None]
        middle = middle + axes @ (0.5 * distance * (np.min(seen, axis=0) + np.max(seen, axis=0)))
    return middle + _ROOM * distance * back, middle


def _has_pyvista() -> bool:
    try:
        import pyvista  # noqa: F401
    except ImportError:
        warnings.warn("pictures in space need PyVista: pip install 'barchan[viz]'", stacklevel=3)
        return False
    return True


def _style(scene: BodyScene, free: bool, glass: bool) -> dict[str, Any]:
    if glass:
        return {"color": "lightgrey", "opacity": 0.12}
    if not free:
        return {"color": _DRIVEN, "smooth_shading": True}
    return {
        "scalars": "value",
        "cmap": COLOUR_MAP,
        "clim": scene.scale,
        "show_scalar_bar": False,
        "smooth_shading": True,
    }


def _add_spheres(plotter: Any, scene: BodyScene, frame: int, free: bool, glass: bool) -> None:
    import pyvista

    chosen = scene.spheres[scene.free[scene.spheres] == free]
    if len(chosen) == 0:
        return
    points = pyvista.PolyData(scene.places(frame)[chosen])
    points["radius"] = scene.radii[chosen]
    points["value"] = scene.values(frame)[chosen]
    sides = 16 if len(chosen) < 3000 else 10
    ball = pyvista.Sphere(radius=1.0, theta_resolution=sides, phi_resolution=sides)
    style = _style(scene, free, glass)
    plotter.add_mesh(points.glyph(geom=ball, scale="radius", orient=False, factor=1.0), **style)


def _add_solids(plotter: Any, scene: BodyScene, frame: int, window: Window, glass: bool) -> None:
    """Bodies that are not spheres by their facets; level planes as ground, other planes and drums as glass."""
    import pyvista

    places, turns, values = scene.places(frame), scene.turns(frame), scene.values(frame)
    lower, upper = window
    for number, body in enumerate(scene.bodies):
        if isinstance(body.shape, Sphere):
            continue
        if isinstance(body.shape, HalfSpace):
            normal = turns[number] @ body.shape.normal
            if normal[2] > 0.5:
                middle = 0.5 * (lower + upper)
                middle = middle - normal * float(normal @ (middle - places[number]) - body.shape.offset)
                across, along = (1.6 * float(v) for v in (upper - lower)[:2])
                ground = pyvista.Plane(center=middle, direction=normal, i_size=across, j_size=along)
                plotter.add_mesh(ground, color="wheat")
            continue
        facets = _facets(body.shape) @ turns[number].T + places[number]
        count = len(facets)
        faces = np.concatenate([np.full((count, 1), 3), np.arange(3 * count).reshape(count, 3)], axis=1)
        mesh = pyvista.PolyData(facets.reshape(-1, 3), faces.ravel())
        mesh["value"] = np.full(3 * count, values[number])
        free = bool(scene.free[number])
        style = _style(scene, free, glass) | {"smooth_shading": False}
        surrounds = not free and bool(np.all(scene.radii[number] > 0.45 * np.min(upper - lower)))
        plotter.add_mesh(mesh, **(style | ({"opacity": 0.15} if surrounds else {})))


def _facets(shape: Any) -> Vector:
    lower, upper = shape.bounds()
    return np.asarray(shape.facets(float(np.max(upper - lower)) / _FACETS, lower, upper))


def _add_forces(plotter: Any, scene: BodyScene, frame: int) -> None:
    """A tube for each contact, from centre to centre."""
    import pyvista

    segments, strengths = scene.chains(frame)
    if len(segments) == 0:
        return
    largest = max(float(np.max(strengths)), 1e-300)
    count = len(segments)
    cells = np.concatenate([np.full((count, 1), 2), np.arange(2 * count).reshape(count, 2)], axis=1)
    lines = pyvista.PolyData(segments.reshape(-1, 3), lines=cells.ravel())
    mean = min(
        float(np.mean(scene.radii[scene.free])), _SLIMMEST * float(np.max(np.ptp(scene.window, axis=0)))
    )
    lines["force"] = np.repeat(strengths, 2)
    lines["radius"] = mean * (_THINNEST + (_WIDEST - _THINNEST) * lines["force"] / largest)
    tubes = lines.tube(scalars="radius", absolute=True, n_sides=8)
    plotter.add_mesh(tubes, scalars="force", cmap=FORCE_MAP, clim=(0.0, largest), show_scalar_bar=False)
