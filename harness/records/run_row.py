"""What one run leaves behind: every key of a record, declared. A key that is missing or unknown is an error."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_serializer, model_validator

from harness.errors import DefrayError, first_problem
from harness.records.digest import check_schema


def checked_row(model: type[Part], schema: int, row: Any, where: str) -> dict:
    """`row` as `model`, a Part with a key `schema`, has it; raises DefrayError naming `where` and the bad key."""
    if not isinstance(row, dict):
        raise DefrayError(f"{where}: not a JSON object")
    check_schema(row, schema, where)
    try:
        return model.model_validate(row).model_dump(mode="json", by_alias=True)
    except ValidationError as error:
        raise DefrayError(f"{where}: {first_problem(error)}") from None


SCHEMA = 2


class Part(BaseModel):
    """A part of a record: undeclared keys and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Machine(Part):
    """Where a run was measured, as `device.machine_description` has it.

    `environment` holds the variables that steer OpenCL runtimes. `device`, `platform` and `driver` are None
    for a machine without OpenCL.
    """

    cpu: str
    cores: int
    memory_bytes: int | None = None
    os: str
    kernel: str | None = None
    governor: str | None = None
    device: str | None
    platform: str | None
    driver: str | None
    versions: dict[str, str | None]
    environment: dict[str, str] = Field(default_factory=dict)


class SceneFacts(Part):
    """The scene's name, `real`, `stand-in` or `file`, the SHA-256 of its triangles, and how views were found."""

    name: str
    source: str
    triangles: int
    sha256: str
    views: str = ""


class RayFacts(Part):
    """Kind, number and seed of the rays."""

    kind: str
    count: int
    seed: int


class GridFacts(Part):
    """Resolution and size of the grid; `bytes` is the whole grid's, `build_seconds` wall clock.

    Of an adaptive grid alone: `density`, leaf cells wanted per triangle, and `resolution`, top cells along x, y, z.
    Of one that was chosen: why, the seconds of choosing and of building the grid on trial (0: it is the one chosen).
    """

    top: int | None = None
    leaf: int | None = None
    reading: str
    options: dict[str, str] | None = None
    cells: int
    nonempty: int
    references: int
    bytes: int
    build_seconds: float
    density: float | None = None
    resolution: list[int] | None = None
    chosen: str | None = None
    choosing_seconds: float | None = None
    trial_build_seconds: float | None = None

    @model_serializer(mode="wrap")
    def _without_absent(self, serialize) -> dict:
        """Without the keys of adaptive and of chosen grids where they say nothing."""
        optional = (
            "top",
            "leaf",
            "options",
            "density",
            "resolution",
            "chosen",
            "choosing_seconds",
            "trial_build_seconds",
        )
        return {key: value for key, value in serialize(self).items() if key not in optional or value is not None}


class StageSeconds(Part):
    """Seconds of each repetition, stage by stage; a stage that the tracer lacks is empty."""

    traverse: list[float]
    arrange: list[float]
    intersect: list[float]
    compact: list[float]
    total: list[float]


class Rate(Part):
    """Rays per second: median and 95 % confidence interval."""

    median: float
    low: float
    high: float


class Rates(Part):
    """Rates of the stages that have one."""

    traverse: Rate | None
    intersect: Rate | None
    total: Rate | None


class CounterValues(Part):
    """The counters of `harness.data.Counters`, exact integers."""

    steps: int
    pairs: int
    tests: int
    lane_tests: int
    waves: int
    finished_per_wave: list[int]
    padding: int


class RelativeError(Part):
    """Relative error of t over the rays that hit in both, by percentile; None where no ray did."""

    p50: float | None
    p99: float | None
    max: float | None


class Agreement(Part):
    """Rays by class of agreement with the reference.

    The first keys are those every version writes; what the others mean, `harness.check.Agreement` says.
    """

    reference: str
    same: int
    tie: int
    t_off: int
    wrong: int
    missed: int
    phantom: int
    reference_wrong: int = 0
    settled: int = 0
    nonfinite: int = 0
    worst_band_ulp: float = 0.0
    rays: int | None = None
    valid: bool | None = None
    reason: str = ""
    t_relative_error: RelativeError | None


class Provenance(Part):
    """What every stored row says of itself: schema, identity, when, by which command of which commit, where."""

    schema_: int = Field(alias="schema")
    id: str
    time_utc: str
    command: str
    commit: str
    dirty: bool
    machine: Machine
    scene: SceneFacts


class Record(Provenance):
    """One run as stored. A run that is not valid, or that was not checked, has no rate.

    `hierarchy_build_seconds`: of Embree's bounding volume hierarchy, wall clock; None for tracers that have none.
    """

    view: str | None
    rays: RayFacts
    grid: GridFacts | None
    tracer: str
    intersector: str | None
    options: dict[str, str]
    repetitions: int
    spec: dict[str, Any]
    samples: StageSeconds
    rate: Rates
    counters: CounterValues
    agreement: Agreement
    hits: int | None = None
    hits_sha256: str | None = None
    hierarchy_build_seconds: float | None = None
    valid: bool

    @model_validator(mode="after")
    def _no_rate_without_validity(self) -> Record:
        has_rate = any((self.rate.traverse, self.rate.intersect, self.rate.total))
        if has_rate and not self.valid:
            raise ValueError("a run that is not valid must not have a rate")
        if self.valid and self.agreement.reference == "none":
            raise ValueError("a run that was not checked must not be valid nor have a rate")
        return self
