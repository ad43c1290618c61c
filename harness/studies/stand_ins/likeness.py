"""How like the real scene a stand-in behaves: the same figures measured of both, side by side."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import scenes
from harness.data import Rays, Scene
from harness.device.opened import Device, open_device
from harness.errors import DefrayError, known
from harness.inputs.rays import make_rays
from harness.inputs.scenes_by_name import real_scene, stand_in_scene
from harness.reference.embree_scene import EmbreeScene
from harness.spec.structure import Uniform
from harness.tracers import open_tracer
from harness.tracers.prepared import Prepared
from scenes import Recipe, recipes

RESOLUTIONS = (32, 64, 128)  # cells per axis
RAYS = 1 << 15
STORED = Path(scenes.__file__).with_name("calibration.toml")
WITHIN = (0.5, 2.0)  # of every ratio of stand-in to real, but for
TRIANGLES_WITHIN = (0.95, 1.05)


@dataclass(frozen=True)
class ComparedFigure:
    """One figure of a scene, real and stand-in; `ratio` is stand-in over real."""

    name: str
    real: float
    stand_in: float

    @property
    def ratio(self) -> float:
        """Infinite where the real figure is zero and the stand-in's is not; 1 where both are."""
        if self.real == 0:
            return 1.0 if self.stand_in == 0 else float("inf")
        return self.stand_in / self.real

    @property
    def inside(self) -> bool:
        """Whether the ratio is near enough to 1; a figure that is not a number never is."""
        low, high = TRIANGLES_WITHIN if self.name == "triangles" else WITHIN
        return low <= self.ratio <= high


@dataclass(frozen=True)
class Calibration:
    """A scene's figures. `source` of the real ones: `measured`, `stored`, or `described` where there is no file."""

    scene: str
    source: str
    figures: tuple[ComparedFigure, ...]

    @property
    def inside(self) -> bool:
        """Whether every figure is."""
        return all(figure.inside for figure in self.figures)

    def to_json(self) -> dict:
        """For standard output; a ratio that is not finite is null."""
        figures = [
            {
                "name": f.name,
                "real": f.real,
                "stand_in": f.stand_in,
                "ratio": f.ratio if np.isfinite(f.ratio) else None,
                "inside": f.inside,
            }
            for f in self.figures
        ]
        return {"scene": self.scene, "real": self.source, "inside": self.inside, "figures": figures}


def cell_figures(cell_start: np.ndarray, triangles: int, cells: int) -> dict[str, float]:
    """How triangles lie in one uniform grid.

    `cell_start` int[k+1]: where the references of each of k non-empty cells begin, and their total; `triangles`:
    of the scene, those without area included; `cells`: of the whole grid, empty ones included.
    """
    held = np.diff(np.asarray(cell_start, np.int64))
    p95, p99 = np.percentile(held, (95, 99))
    return {
        "non-empty cells, share": len(held) / cells,
        "references a triangle": float(held.sum()) / triangles,
        "triangles a cell, mean": float(held.mean()),
        "triangles a cell, 95 %": float(p95),
        "triangles a cell, 99 %": float(p99),
    }


def measure(scene: Scene, device: Device, rays: int = RAYS) -> dict[str, float]:
    """The figures of a scene by name, its diffuse rays those of its first view.

    A ray's cells are counted on its way to the hit that Embree finds; a cell is a leaf cell, or an empty cell of
    the top level, which is stepped over at once.
    """
    embree = EmbreeScene(scene.triangles)
    diffuse = make_rays(scene, "diffuse", rays, embree=embree)
    hits = embree.trace(diffuse)
    to_hit = Rays(diffuse.origins, diffuse.directions, np.minimum(hits.t, diffuse.t_max), diffuse.kind, diffuse.seed)
    figures = {"triangles": float(len(scene)), "rays that hit, share": float((hits.primitive >= 0).mean())}
    prepared = Prepared.on_device(scene, device)
    for resolution in RESOLUTIONS:
        tracer = open_tracer(prepared.with_structure(Uniform(8, resolution)), "deferred")
        counted = tracer.walk_counts(to_hit)
        here = cell_figures(tracer.structure.cell_start.get(), len(scene), resolution**3)
        here["cells a ray, non-empty"] = counted.pairs / rays
        here["cells a ray, all"] = counted.steps / rays
        figures |= {f"{resolution}: {name}": value for name, value in here.items()}
    return figures


def stored_figures(recipe: Recipe, file: Path = STORED) -> dict[str, float]:
    """What was measured of the real scene and is kept with the project, or derived from its description.

    Raises DefrayError where the file holds nothing for the scene or was measured of other files.
    """
    tables = tomllib.loads(file.read_text(encoding="utf-8"))
    if recipe.name not in tables:
        raise DefrayError(f"{file.name} holds no figures of {recipe.name}")
    table = tables[recipe.name]
    if table["sha256"] != [digest for _, digest in recipe.files]:
        raise DefrayError(f"the figures of {recipe.name} in {file.name} were measured of other files")
    return table["figures"]


def stored_digest(recipe: Recipe, file: Path = STORED) -> str:
    """SHA-256 of the stand-in's triangles, the same on every machine."""
    return tomllib.loads(file.read_text(encoding="utf-8"))[recipe.name]["stand_in"]


def calibrate(
    names: Sequence[str], device: Device, progress: Callable[[str], None] | None = None
) -> list[Calibration]:
    """Measure stand-ins and, where DEFRAY_SCENES holds them, the real scenes; else what is stored of them."""
    results = []
    for name in names:
        recipe = recipes()[name]
        if progress:
            progress(name)
        real, source = real_scene(recipe), "stored" if recipe.files else "described"
        if real:
            figures, source = measure(real, device), "measured"
            del real
        else:
            figures = stored_figures(recipe)
        found = measure(stand_in_scene(recipe), device)
        results.append(Calibration(name, source, compare(figures, found)))
    return results


def compare(real: dict[str, float], found: dict[str, float]) -> tuple[ComparedFigure, ...]:
    """Figures side by side, in the order of the stand-in's; raises DefrayError where one is missing."""
    missing = set(found) ^ set(real)
    if missing:
        raise DefrayError(f"figures of only one of real scene and stand-in: {', '.join(sorted(missing))}")
    return tuple(ComparedFigure(name, real[name], value) for name, value in found.items())


def calibrated_names(chosen: str | None = None) -> list[str]:
    """Scenes that have a stand-in, or those of `chosen` (names with commas); raises DefrayError for others."""
    all_names = [recipe.name for recipe in recipes().values() if recipe.stand_in]
    names = [name.strip() for name in (chosen or "").split(",") if name.strip()] or all_names
    for name in names:
        if name not in all_names:
            raise known("scene with a stand-in", name, all_names)
    return names


def write_stored(device: Device, file: Path = STORED) -> None:
    """Measure the real scenes under DEFRAY_SCENES and write them down; what is not there stays as it is.

    Beside the figures stands the stand-in's SHA-256, for other machines to compare.
    """
    old = tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    lines = [
        "# Figures of the real scenes, named by `measure` in harness/studies/stand_ins/likeness.py and measured by",
        "# `DEFRAY_SCENES=FOLDER python -m harness.studies.stand_ins.likeness`. Hairball has no file: its figures",
        "# follow from its description (see scenes/hairball_figures.py).",
    ]
    for name in calibrated_names():
        recipe = recipes()[name]
        real = real_scene(recipe)
        if real:
            figures = measure(real, device)
        elif recipe.described:
            figures = recipe.described(RESOLUTIONS)
        else:
            figures = old.get(name, {}).get("figures", {})
        digests = ", ".join(f'"{digest}"' for _, digest in recipe.files)
        lines += ["", f"[{name}]", f"sha256 = [{digests}]", f'stand_in = "{stand_in_scene(recipe).sha256}"']
        lines.append(f"[{name}.figures]")
        lines += [f'"{key}" = {float(f"{value:.5g}") if value < 1e5 else value!r}' for key, value in figures.items()]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_stored(open_device(None))
