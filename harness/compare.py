"""Compare variants measured interleaved: ratios of their rates to the first one's."""

from __future__ import annotations

from collections.abc import Sequence

from harness import stats
from harness.errors import DefrayError
from harness.spec import RunSpec


def scene_names(text: str) -> list[str]:
    """Scenes of `A,B`, each once; raises DefrayError where there is none, or one that is not known."""
    from harness.scene import check_name

    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise DefrayError(f"--scenes '{text}' names no scene")
    for name in names:
        check_name(name)
    return names


def comparison(specs: Sequence[RunSpec], records: Sequence[dict]) -> dict:
    """`{scene, rays, grid, base, rows, records}` of one group; the first spec is the base.

    A row is `{variant, valid, rate, ratio, p_value, tests_per_ray}`: `rate` and `ratio` as
    `{median, low, high}`, in rays per second and relative to the base; None where a check failed. `p_value`
    is that of the Mann-Whitney test against the base, None for the base itself.
    """
    base = _samples(records[0])
    rows = []
    for number, (spec, record) in enumerate(zip(specs, records, strict=True)):
        rates = _samples(record)
        comparable = bool(number and rates and base)
        rows.append(
            {
                "variant": str(spec.variant),
                "valid": record["valid"],
                "rate": record["rate"]["total"],
                "ratio": stats.ratio(rates, base).as_dict() if comparable else None,
                "p_value": stats.different_p_value(rates, base) if comparable else None,
                "tests_per_ray": record["counters"]["tests"] / record["rays"]["count"],
            }
        )
    return {
        "scene": records[0]["scene"],
        "rays": records[0]["rays"],
        "grid": str(specs[0].grid) if specs[0].grid else None,
        "base": str(specs[0].variant),
        "rows": rows,
        "records": list(records),
    }


def _samples(record: dict) -> list[float]:
    """Rates of all repetitions; none when the check failed."""
    if not record["valid"] or not record["rate"]["total"]:
        return []
    return stats.rates_of(record["samples"]["total"], record["rays"]["count"])
