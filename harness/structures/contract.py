"""The contract of structures: what a tracer may ask of what it walks, whatever that is.

A structure is one file of this folder and one kernel header. The file has a subclass of `Structure` and names it
`STRUCTURE`; the header defines how rays walk (kernels/structures/walk.clh says what). Everything that holds a list of
triangles is a cell to the tracers: a grid's leaf cell, a hierarchy's leaf.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from harness.device.runtime import cl
from harness.errors import DefrayError, first_problem, known
from harness.spec.structure import StructureSpec
from harness.structures.device_scene import DeviceScene


class StructureOptions(BaseModel):
    """Options of a structure given as `key=value`; a structure's own class adds to it."""

    model_config = ConfigDict(extra="forbid")


@dataclass(frozen=True)
class WalkWork:
    """What walking computes and reads, by the rule of kernels/intersect.clh: flops to enter and to set up a ray, of a
    ray each wave, and of a step; `tables`: bytes of each table and bytes read of it a step."""

    start_flops: int
    ray_flops: int
    step_flops: int
    tables: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure(ABC):
    """What space is cut into, on the device.

    `cell_start` int32[nonempty+1], `references` int32[r]: the triangles of each cell that holds any, in ascending
    order. `overlap`: the test of triangle and cell that filled it, one of OVERLAPS; a structure that has no such test
    ignores it. `build_seconds`: wall clock.
    """

    name: ClassVar[str]
    header: ClassVar[str]  # under kernels/: what `#include STRUCTURE` stands for
    Options: ClassVar[type[StructureOptions]] = StructureOptions

    spec: StructureSpec
    cell_start: cl.array.Array
    references: cl.array.Array
    nonempty: int
    build_seconds: float
    overlap: str = "padded"

    @classmethod
    @abstractmethod
    def build(cls, scene: DeviceScene, spec: StructureSpec, overlap: str = "padded") -> Self:
        """Build it from the scene; raises DefrayError for what makes no sense or needs too much memory."""

    @property
    @abstractmethod
    def arguments(self) -> tuple:
        """Its data as kernel arguments, in the order of the header's STRUCTURE_ARGUMENTS."""

    @property
    def defines(self) -> dict[str, int]:
        """Definitions that fix the walk when kernels are built."""
        return {}

    @property
    @abstractmethod
    def table_bytes(self) -> int:
        """Bytes of the tables that a walk reads, lists of triangles left out."""

    @property
    def bytes(self) -> int:
        """Bytes of all arrays."""
        return self.table_bytes + self.cell_start.nbytes + self.references.nbytes

    @property
    def walk_work(self) -> WalkWork | None:
        """For a roofline of the kernels that walk; None where it is not stated."""
        return None

    @property
    @abstractmethod
    def most_cells_met(self) -> int:
        """At most so many cells lie on one ray's way."""

    def describe(self) -> dict:
        """The `grid` part of a record: the spec, its size, the seconds of building."""
        return {
            **self.spec.to_json(),
            "cells": self.nonempty,
            "nonempty": self.nonempty,
            "references": len(self.references) if self.nonempty else 0,
            "bytes": self.bytes,
            "build_seconds": self.build_seconds,
        }

    @classmethod
    def options(cls, spec: StructureSpec) -> StructureOptions:
        """Options of a spec that gives them as text, validated; raises DefrayError naming the option."""
        given = dict(getattr(spec, "options", ()))
        for name in given:
            if name not in cls.Options.model_fields:
                raise known(f"option of structure {cls.name}", name, cls.Options.model_fields)
        try:
            return cls.Options(**given)
        except ValidationError as error:
            raise DefrayError(f"structure {spec}: {first_problem(error)}") from None
