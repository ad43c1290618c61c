"""What the accuracy charts share: names, families and marks of variants, and their rows as a table."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.report.figures import style
from harness.stats import megarays, rate_bound

# Marker and title of each family of intersectors; a name belongs to the longest prefix that fits.
FAMILIES = {
    "ray-space": ("o", "ray space"),
    "moller-trumbore": ("s", "Möller–Trumbore"),
    "woop-benthin-wald": ("D", "Woop–Benthin–Wald"),
    "plucker": ("P", "Plücker"),
    "pbrt": ("X", "pbrt"),
    "kensler-shirley": ("v", "Kensler–Shirley"),
    "baldwin-weber": ("<", "Baldwin–Weber"),
    "woop-unit": ("p", "Woop unit triangle"),
    "havel-herout": ("h", "Havel–Herout"),
    "": ("^", "Embree's own"),
}


def intersector_family(intersector: str | None) -> tuple[str, str]:
    """Marker and title of an intersector's family; an unknown one is its own family."""
    if not intersector:
        return FAMILIES[""]
    fitting = [prefix for prefix in FAMILIES if prefix and intersector.startswith(prefix)]
    return FAMILIES[max(fitting, key=len)] if fitting else ("*", intersector)


def intersector_name(intersector: str | None) -> str:
    """`ray space`, `ray space, folded`: an intersector for people."""
    if not intersector:
        return ""
    title = intersector_family(intersector)[1]
    prefix = next((p for p in FAMILIES if p and FAMILIES[p][1] == title), intersector)
    rest = intersector.removeprefix(prefix).strip("-").replace("-", " ").replace("kahan", "Kahan")
    return title if title == "Woop unit triangle" else ", ".join(part for part in (title, rest) if part)


def variant_name(row: pd.Series) -> str:
    """A variant for people: intersector, then whatever is not the default; Embree by its mode."""
    if row["tracer"] == "embree":
        return "Embree fast" if row["options"].get("robust") == "false" else "Embree robust"
    parts = [intersector_name(row["intersector"])]
    parts += ["contracted"] if row["contraction"] == "on" else []
    parts += [f"{row['overlap']} overlap"] if row["overlap"] not in (None, "padded") else []
    parts += [f"{key} {value}" for key, value in row["options"].items() if key != "contraction"]
    return ", ".join(parts)


def accuracy_table(runs: Results) -> pd.DataFrame:
    """One row a variant and scene, in the paper's order of scenes; rates in millions of rays a second.

    `leak_rate`: as observed; `leak_bound`: its upper 95 % bound, by which variants are compared, so that one of which
    few rays were traced does not look better than it is shown to be.
    """
    rows = []
    for row in runs.accuracy:
        aimed, rate = row.aimed, row.rate
        rows.append(
            {
                "scene": runs.title_of(row.scene),
                "place": runs.scene_place(row.scene.name),
                "tracer": row.tracer,
                "intersector": row.intersector or "",
                "contraction": row.contraction,
                "overlap": row.overlap,
                "options": row.options,
                "variant": row.variant,
                "triangles": row.scene.triangles,
                "rays": row.rays.count,
                "aimed": aimed.rays,
                "leaks": aimed.leaks,
                "leak_rate": aimed.leaks / aimed.rays,
                "leak_bound": rate_bound(aimed.leaks, aimed.rays),
                "rate": megarays(rate.median),
                "rate_low": megarays(rate.low),
                "rate_high": megarays(rate.high),
                "t_error_p99": row.t_error.p99,
                "residual_p99_ulp": row.residual_p99_ulp,
                "distance_rmse": row.distance_rmse,
                "valid": row.valid,
                "run": row.id,
                "seconds": row.seconds,
            }
        )
    table = pd.DataFrame(rows)
    if table.empty:
        return table
    table["name"] = [variant_name(row) for _, row in table.iterrows()]
    most = table.groupby("scene")["rays"].transform("max")  # rates of different numbers of rays make no chart
    by = ["place", "triangles", "scene", "tracer", "variant"]
    return (
        table[table["rays"] == most]
        .sort_values(by, kind="stable")
        .drop_duplicates(["scene", "variant"], keep="last")
        .reset_index(drop=True)
    )


def marks(row, solid: bool) -> dict:
    """How one point looks: colour by tracer, marker by family, faded where it is dominated."""
    colour, _ = style.tracer_look(row.tracer)
    return {"color": colour, "marker": intersector_family(row.intersector)[0], "alpha": 1.0 if solid else 0.3}
