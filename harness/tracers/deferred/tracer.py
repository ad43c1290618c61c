"""Deferred tracing with intersection binning: the paper's tracer (section 2).

A wave walks each unfinished ray through at most `wave` non-empty cells without testing a triangle, arranges
the ray-cell pairs so that pairs of one cell are adjacent, and intersects bin after bin.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from harness.data import Counters, Rays
from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.spec.tracer_facts import TracerFacts
from harness.tracers.batch import Batch
from harness.tracers.deferred.bins import Bins
from harness.tracers.deferred.bins_packed import GroupBins
from harness.tracers.deferred.compaction import compact
from harness.tracers.deferred.recording import Recording
from harness.tracers.deferred.sort import SortedRecording
from harness.tracers.deferred.two_pass import TwoPass
from harness.tracers.deferred.wave import Wave
from harness.tracers.device_tracer import COUNTERS, DeviceOptions, DeviceTracer

ENDLESS = 1 << 30  # more cells than a ray can meet
LONGEST_WAVE = 4096  # cells; beyond, say `all`
ARRANGEMENTS = {"two-pass": TwoPass, "record": Recording, "sort": SortedRecording}


class DeferredOptions(DeviceOptions):
    """`arrange`: walk twice (the paper), walk once and remember, or remember and sort; `wave`: non-empty cells a ray,
    or `all`; `growth`: times as many in each wave as in the one before; `pairs`: whether a bin holds the index of a
    ray, which the intersector gathers, or a copy of the ray; `form`: the intersector tests a bin's rays in the lanes
    of a vector, or a work-item each, in groups (a GPU's default)."""

    arrange: Literal["two-pass", "record", "sort"] = "two-pass"
    wave: str = "4"
    compaction: bool = True
    pairs: Literal["index", "copy"] = "index"
    growth: int = Field(default=1, ge=1, le=64)
    form: Literal["auto", "lanes", "group"] = "auto"

    @field_validator("wave")
    @classmethod
    def _positive_or_all(cls, wave: str) -> str:
        if wave != "all" and not (wave.isdigit() and 0 < int(wave) <= LONGEST_WAVE):
            raise ValueError(f"must be a whole number from 1 to {LONGEST_WAVE}, or 'all'")
        return wave

    @field_validator("form")
    @classmethod
    def _one_lane(cls, form: str, info: ValidationInfo) -> str:
        if form == "group" and info.data.get("lanes") not in ("auto", "1"):
            raise ValueError("a group's work-items have one lane each; leave lanes out")
        return form

    @property
    def cells(self) -> int:
        """Non-empty cells a ray in one wave."""
        return ENDLESS if self.wave == "all" else int(self.wave)

    @property
    def pair_words(self) -> int:
        """32-bit words of a pair in its bin."""
        return 8 if self.pairs == "copy" else 1

    @property
    def defines(self) -> dict[str, int]:
        """Definitions for the kernels that write and read pairs."""
        return {"COPY_RAYS": 1} if self.pairs == "copy" else {}


class Deferred(DeviceTracer):
    """Walk, bin, intersect, compact; wave after wave until no ray is left."""

    name = "deferred"
    needs_structure = True
    Options = DeferredOptions
    start_stage = "traverse"
    warm_up_rays = 1 << 20  # PoCL compiles kernels anew for small launches, so few rays would warm only those

    @property
    def in_groups(self) -> bool:
        """Whether the intersector takes a ray a work-item, in work-groups."""
        one_lane = self.options.lanes == "1" or (self.options.lanes == "auto" and self.device.native_lanes == 1)
        return self.options.form == "group" or (self.options.form == "auto" and one_lane and not self.device.is_cpu)

    @property
    def lanes(self) -> int:
        """Rays walked and tested at a time: one where each has a work-item of its own."""
        return 1 if self.in_groups else super().lanes

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """All waves of one batch."""
        queue = self.device.queue
        walk_lanes = self.lanes if self.options.arrange == "two-pass" else self.exchanged_lanes
        walk = self.program(
            "tracers/deferred/walk.cl", walks=True, walk_lanes=walk_lanes, defines=self.options.defines
        )
        bins = GroupBins(self) if self.in_groups else Bins(self)
        arrange = ARRANGEMENTS[self.options.arrange]
        active, active_count = cl.array.arange(queue, batch.count, dtype=np.int32), batch.count
        spare = self.buffers.get("spare", batch.count)
        length = self.options.cells
        while active_count:
            arranged = arrange(Wave(self, batch, walk, bins, active, active_count, length))
            length = min(length * self.options.growth, ENDLESS)
            with watch.stage("traverse"):
                bins.clear()
                arranged.walk()
            with watch.stage("arrange"):
                arranged.count()
                bins.lay_out()
                arranged.scatter()
            if not bins.chunks:
                self._count_finished(active_count)
                break
            with watch.stage("traverse"):
                arranged.walk_again()
            with watch.stage("intersect"):
                bins.intersect(batch)
            self._count_wave(bins)
            if self.options.compaction or self.counters is not None:
                with watch.stage("compact"):
                    kept = compact(self.device, active, spare, batch, active_count)
                active, spare = spare, active
                self._count_finished(active_count - kept)
                active_count = kept

    def walk_counts(self, rays: Rays) -> Counters:
        """Steps and pairs of walking every ray to its t_max, without testing a triangle."""
        self.counters, counted = cl.array.zeros(self.device.queue, len(COUNTERS), np.uint64), Counters()
        walk = self.program("tracers/deferred/walk.cl", walks=True, walk_lanes=self.lanes)
        cell_count = cl.array.zeros(self.device.queue, self.structure.nonempty + 1, np.int32)
        for first in range(0, len(rays), self.batch_size):
            batch = Batch(self.device, rays[first : first + self.batch_size])
            self.start(batch)
            active = cl.array.arange(self.device.queue, batch.count, dtype=np.int32)
            arguments = (batch.count, active, batch.rays, batch.keys, *self.structure.arguments, ENDLESS)
            outputs = (batch.positions, batch.t_exit, cell_count, *self.counting)
            walk.launch("count_pairs", -(-batch.count // self.lanes), *arguments, *outputs)
        for name, value in zip(COUNTERS, self.counters.get(), strict=True):
            setattr(counted, name, int(value))
        self.counters = None
        return counted

    def _count_wave(self, bins: Bins) -> None:
        if self.counters is not None:
            self.counted.waves += 1
            self.counted.padding += bins.chunks * self.lanes - bins.pair_count()

    def _count_finished(self, finished: int) -> None:
        if self.counters is not None:
            self.counted.finished_per_wave.append(finished)


TRACER = Deferred
FACTS = TracerFacts(
    order=1,
    colour="blue",
    marker="o",
    kernels={
        "count_pairs": "walk and count",
        "pack_pairs": "walk and pack",
        "record_pairs": "walk",
        "rank_pairs": "rank",
        "lay_out_bins": "lay out bins",
        "count_chunks": "count chunks",
        "lay_out_blocks": "lay out bins",
        "scatter_pairs": "scatter",
        "intersect_bins": "intersect",
        "keep_in_blocks": "compact",
        "join_blocks": "compact, join",
    },
    test_kernels=("intersect_bins",),
    terms={
        "traverse": ("active", "steps", "far_steps", "cell_waves"),
        "arrange": ("pairs", "far_pairs", "cell_waves"),
        "intersect": ("slots", "lane_tests", "far_slots", "far_tests"),
        "compact": ("active", "waves"),
        "rest": ("one", "waves"),
    },
    fast_options={"arrange": "record", "pairs": "copy"},
    fitted_options=({"wave": "2"}, {"wave": "8", "growth": "2"}),
    fitted_rays=1_048_576,  # of fewer rays more of the time goes into reading triangles for the first time
)
