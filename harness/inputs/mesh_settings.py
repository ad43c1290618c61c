"""The TOML file beside a mesh: `mesh.toml` says of `mesh.obj` what the mesh itself cannot.

up = "z"                    # or "x", "y" (the default), "-y" ...: turns the views, never the geometry
scale = 0.01                # multiplies every coordinate, those of the views too
licence = "CC BY 4.0"

[[views]]                   # cameras in the units of the mesh; the first is the default; none: they are found
name = "front"
eye = [0, 1, 5]
target = [0, 1, 0]
up = [0, 1, 0]              # the up axis by default
fov_degrees = 45            # vertical, 60 by default
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationError, model_validator

from harness.data import Strict, View
from harness.errors import DefrayError, first_problem
from harness.inputs.viewpoints import up_vector

Coordinate = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Coordinate, Coordinate, Coordinate]


def _not_zero(vector: Vector) -> Vector:
    if not any(vector):
        raise ValueError("is zero, and points nowhere")
    return vector


class Camera(Strict):
    """One view, in the units of the mesh."""

    name: str = Field(default="", max_length=60)
    eye: Vector
    target: Vector
    up: Annotated[Vector, AfterValidator(_not_zero)] | None = None
    fov_degrees: float = Field(default=60.0, gt=0, lt=180)

    @model_validator(mode="after")
    def _looks_somewhere(self) -> Camera:
        if self.eye == self.target:
            raise ValueError("eye and target are the same point")
        return self


class Sidecar(Strict):
    """What a `mesh.toml` may say; every key may be left out."""

    up: Literal["x", "y", "z", "-x", "-y", "-z"] = "y"
    scale: float = Field(default=1.0, gt=0, allow_inf_nan=False)
    licence: str = "unknown"
    views: list[Camera] = Field(default_factory=list)

    @model_validator(mode="after")
    def _each_view_has_a_name_and_a_picture(self) -> Sidecar:
        names = [view.name or f"view {number}" for number, view in enumerate(self.views, 1)]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise ValueError(f"two views are named '{twice}'")
        for view, name in zip(self.views, names):
            view.name = name
            up = np.asarray(view.up or up_vector(self.up))
            ahead = np.subtract(view.target, view.eye)
            if np.linalg.norm(np.cross(ahead, up)) <= 1e-6 * np.linalg.norm(ahead) * np.linalg.norm(up):
                raise ValueError(f"view '{name}' looks along its up axis, which leaves open what is right and left")
        return self

    def scaled_views(self) -> tuple[View, ...]:
        """The views in scene units: those of the mesh, times `scale`."""
        return tuple(
            View(
                tuple(self.scale * x for x in view.eye),
                tuple(self.scale * x for x in view.target),
                tuple(float(x) for x in view.up or up_vector(self.up)),
                view.fov_degrees,
                view.name,
            )
            for view in self.views
        )


def sidecar_path(mesh: Path) -> Path:
    """`scenes/room.toml` for `scenes/room.obj`."""
    return mesh.with_suffix(".toml")


def read_sidecar(mesh: Path) -> Sidecar | None:
    """The checked TOML file beside `mesh`, or None where there is none; raises DefrayError naming the bad key."""
    path = sidecar_path(mesh)
    try:
        with path.open("rb") as file:
            return Sidecar.model_validate(tomllib.load(file))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DefrayError(f"cannot read {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DefrayError(f"{path}: not TOML: {error}") from None
    except ValidationError as error:
        raise DefrayError(f"{path}: {first_problem(error)}") from None
