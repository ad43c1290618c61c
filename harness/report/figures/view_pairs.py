"""The real scenes beside their stand-ins, seen by ambient occlusion."""

from __future__ import annotations

import matplotlib.image
import pandas as pd

from harness.analysis.results import Results
from harness.report.entry import Figure, Machines
from harness.report.figures import style
from harness.spec.run_spec import STAND_IN

HEADINGS = ("real", "stand-in")


def select(runs: Results) -> pd.DataFrame:
    """Each real scene of which both pictures exist."""
    scenes = runs.scenes[runs.scenes["source"] == "real"]
    both = [runs.view_file(name).is_file() and _stand_in_file(runs, name).is_file() for name in scenes["scene"]]
    scenes = scenes[pd.Series(both, index=scenes.index, dtype=bool)]  # a list without entries would choose columns
    return pd.DataFrame({"scene": scenes["title"], "name": scenes["scene"], "triangles": scenes["triangles"]})


def _stand_in_file(runs: Results, name: str):
    return runs.view_file(name).with_name(f"{name}{STAND_IN}.png")


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What the panels show."""
    return (
        "The real scene and the geometry generated in its stead, each from its first view, shaded by ambient "
        "occlusion. A stand-in is calibrated to lie in grids and to meet diffuse rays as the real scene does, "
        "and modelled no further than that takes."
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A row a scene on a narrow page; two scenes a row, four pictures, on a wide one."""
    pairs = 1 if narrow else 2
    rows = -(-len(numbers) // pairs)
    panel = (style.NARROW if narrow else style.WIDE) / (2 * pairs) - 0.1
    figure = style.canvas(rows * (0.75 * panel + 0.45), narrow)
    axes = figure.subplots(rows, 2 * pairs, squeeze=False)
    for axis in axes.ravel():
        axis.set_axis_off()
    for place, row in enumerate(numbers.itertuples()):
        beside = axes[place // pairs, 2 * (place % pairs) :][:2]
        for axis, file, kind in zip(
            beside, (runs.view_file(row.name), _stand_in_file(runs, row.name)), HEADINGS, strict=True
        ):
            axis.imshow(matplotlib.image.imread(file), interpolation="antialiased", cmap="gray")
            axis.set_title(f"{row.scene}, {kind}", fontsize=9, loc="left")
    return figure


FIGURE = Figure(
    name="view_pairs",
    section="Scenes",
    title="Real scenes and their stand-ins",
    needs="runs on real scenes, and the pictures that 'defray views' renders of them and of their stand-ins",
    machines=Machines.SHARED,
    files=("views/*.png",),
    select=select,
    caption=caption,
    draw=draw,
)
