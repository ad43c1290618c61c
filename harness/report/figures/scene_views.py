"""Figure 1, top: the view of each scene, ambient occlusion by our own tracer."""

from __future__ import annotations

import math

import matplotlib.image
import pandas as pd
from matplotlib.patches import Rectangle

from harness.analysis.names import scene_and_size, short_number
from harness.analysis.results import Results
from harness.report.entry import Figure, Machines
from harness.report.figures import style


def select(runs: Results) -> pd.DataFrame:
    """Each scene with its size and whether its picture exists."""
    scenes = runs.scenes[[scene_and_size(name)[1] == "1" for name in runs.scenes["scene"]]]
    counts = scenes["scene"].map(runs.all.groupby("scene")["run"].agg(" ".join))
    drawn = [runs.view_file(name).is_file() for name in scenes["scene"]]
    return pd.DataFrame(
        {
            "scene": scenes["title"],
            "source": scenes["source"],
            "triangles": scenes["triangles"],
            "picture": drawn,
            "name": scenes["scene"],
            "runs": counts,
        }
    )


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What the panels show."""
    text = "Figure 1, top. The scenes' views, shaded by ambient occlusion."
    if (numbers["source"] == "stand-in").any():
        text += " A stand-in is generated geometry of about the original's size and kind, not the original."
    return text


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """One panel a scene, five in a row (two on a narrow page)."""
    columns = 2 if narrow else max(3, min(5, len(numbers)))
    rows = math.ceil(len(numbers) / columns)
    pictures = [_picture(runs.view_file(name)) for name in numbers["name"]]
    shape = next((picture.shape for picture in pictures if picture is not None), (3, 4))
    panel = (style.NARROW if narrow else style.WIDE) / columns - 0.15
    figure = style.canvas(rows * (panel * shape[0] / shape[1] + 0.6), narrow)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, row, picture in zip(axes, numbers.itertuples(), pictures, strict=False):
        _panel(axis, row, picture, shape[0] / shape[1])
    return figure


def _picture(path):
    return matplotlib.image.imread(path) if path.is_file() else None


def _panel(axis, row, picture, height: float) -> None:
    """A picture, or an empty field of the others' shape, under its name and over its size."""
    axis.set_anchor("N")
    name, _, kind = row.scene.partition(" (")
    for text, above, weight in ((name, 14, "bold"), (f"({kind}" if kind else "", 5, "normal")):
        axis.annotate(
            text,
            (0.5, 1),
            (0, above),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="center",
            va="baseline",
            fontweight=weight,
        )
    size = f"{short_number(row.triangles)} triangles"
    if picture is not None:
        axis.imshow(picture, interpolation="antialiased", cmap="gray")
    else:
        axis.set(xlim=(0, 1), ylim=(0, height), aspect="equal")
        axis.add_patch(Rectangle((0, 0), 1, height, facecolor=style.BAND, edgecolor="none"))
        axis.text(0.5, height / 2, "view not\nrendered", ha="center", va="center", color=style.MUTED)
    axis.text(0.5, -0.03, size, ha="center", va="top", color=style.MUTED, transform=axis.transAxes)


FIGURE = Figure(
    name="views",
    section="Figure 1 of the paper",
    title="Views",
    needs="any run, and the pictures in views/",
    machines=Machines.SHARED,
    files=("views/*.png",),
    select=select,
    caption=caption,
    draw=draw,
)
