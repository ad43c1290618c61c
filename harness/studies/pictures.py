"""Pictures of scenes: ambient occlusion by the deferred tracer."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from harness import tracers
from harness.data import Hits, Rays, View
from harness.inputs.rays import bounce, image_rays
from harness.inputs.scenes_by_name import is_real, stand_in_scene
from harness.measure.scene import Scenes
from harness.spec.run_spec import STAND_IN, split_size
from harness.spec.structure import Uniform
from harness.tracers.prepared import Prepared
from scenes import recipes

WIDTH, HEIGHT = 480, 360
SAMPLES = 16  # occlusion rays a pixel
FACING = 0.35  # share of the shade that follows the angle to the eye, so that open surfaces keep their shape
BACKGROUND = 0.5
SEED = 7


def uniform_grid(triangles: int) -> Uniform:
    """A total resolution for a scene of that many triangles: the power of two nearest to cbrt(5 N) an axis.

    5 cells a triangle is the density of Kalojanov & Slusallek 2009 for one uniform level.
    """
    leaf = 2 ** max(3, round(math.log2(max(triangles, 1) * 5) / 3))
    return Uniform(8, min(leaf, 1024))


class Renderer:
    """A scene ready to be rendered, on a device."""

    def __init__(self, prepared: Prepared):
        self.prepared = prepared.with_structure(uniform_grid(len(prepared.scene)))
        self.tracer = tracers.open_tracer(self.prepared, "deferred")

    def trace(self, rays: Rays) -> Hits:
        """First hits by the deferred tracer."""
        return self.tracer.timed(rays)[0]

    def render(self, view: View, width: int = WIDTH, height: int = HEIGHT, samples: int = SAMPLES) -> np.ndarray:
        """Grey image uint8[height,width]: the share of open sky near each point, darker where it turns away."""
        primary = image_rays(view, width, height)
        primitive = self.trace(primary).primitive
        hit = primitive >= 0
        brightness = np.full(len(primary), BACKGROUND)
        if hit.any():
            occlusion = self._open_share(primary[hit], primitive[hit], samples)
            facing = self._facing(primary[hit], primitive[hit])
            brightness[hit] = occlusion * (1 - FACING + FACING * facing)
        return (255 * np.clip(brightness, 0, 1) ** (1 / 1.6)).astype(np.uint8).reshape(height, width)

    def _open_share(self, primary: Rays, primitive: np.ndarray, samples: int) -> np.ndarray:
        """float64[n]: occlusion rays that reach nothing, over all."""
        free, cast = np.zeros(len(primary)), np.zeros(len(primary))
        for turn in range(samples):
            rays, pixels = bounce(self.prepared.scene, primary, primitive, "ambient-occlusion", SEED, turn)
            free[pixels] += self.trace(rays).primitive < 0
            cast[pixels] += 1
        return np.divide(free, cast, out=np.ones_like(free), where=cast > 0)

    def _facing(self, primary: Rays, primitive: np.ndarray) -> np.ndarray:
        """float64[n]: cosine between the surface and the eye."""
        corners = self.prepared.scene.triangles[primitive].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        along = np.abs(np.einsum("ij,ij->i", normal, primary.directions.astype(np.float64)))
        return along / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)


def write_views(folder: Path, scenes: dict[str, str], device) -> list[Path]:
    """Render the first view of each scene to `folder`/SCENE.png; pictures that exist stay as they are.

    `scenes`: the names in records, and what `load_scene` finds each by. A real scene that has a stand-in gets that
    one's picture too, SCENE-stand-in.png. Raises DefrayError for a scene that cannot be loaded.
    """
    written, kept = [], Scenes(device)
    folder.mkdir(parents=True, exist_ok=True)
    for name, found_by in scenes.items():
        if split_size(name)[1] != "1":
            continue  # a rung of the size ladder looks as its full scene does
        written += _write(folder / f"{name}.png", lambda found_by=found_by: kept.load(found_by).prepared)
        recipe = recipes().get(name)
        if recipe and recipe.stand_in and is_real(recipe):
            stand_in = partial(stand_in_scene, recipe)
            written += _write(
                folder / f"{name}{STAND_IN}.png", lambda made=stand_in: Prepared.on_device(made(), device)
            )
    return written


def _write(file: Path, setting_of: Callable[[], Prepared]) -> list[Path]:
    """Render one picture unless it exists; the files written."""
    if file.is_file():
        return []
    prepared = setting_of()
    part = file.with_suffix(".part")
    Image.fromarray(Renderer(prepared).render(prepared.scene.views[0])).save(part, format="png")
    part.replace(file)
    return [file]
