"""Families W: rays aimed at the vertices and edges of closed meshes, from inside."""

from __future__ import annotations

import numpy as np

from harness.data import Rays
from harness.studies.stability.closed_meshes import Mesh, closed_mesh, icosphere, lattice_box
from harness.studies.stability.pairs import Pairs

STEP = 2.0**-10  # vertices and origins of exact ties are multiples of it
FLAT = 2.0**-13  # what z is multiplied with to flatten a mesh: 1.2e-4, a power of two so that ties stay ties


def aimed_pairs(case: dict, count: int, generator: np.random.Generator) -> Pairs:
    """`count` rays and the triangles around their targets.

    `case`: `mesh` icosphere or lattice; `aim` vertex, edge or tie (exactly at vertices and edge middles); `shift`
    moves mesh and rays along every axis; `flat` flattens them along z.
    """
    lattice, tie = case["mesh"] == "lattice", case["aim"] == "tie"
    vertices, faces = lattice_box() if lattice else icosphere(2, generator)
    origins = _lattice_origins(count, generator) if lattice else _ball(count, generator)
    if tie and not lattice:
        vertices, origins = (np.round(values / STEP) * STEP for values in (vertices, origins))
    if case.get("flat"):
        vertices, origins = (values * [1, 1, FLAT] for values in (vertices, origins))
    shift = case.get("shift", 0.0)
    mesh = closed_mesh((vertices + shift).astype(np.float32), faces)
    origins = (origins + shift).astype(np.float32)
    at_vertex = np.arange(count) % 2 == 0 if tie else np.full(count, case["aim"] == "vertex")
    return _aim(mesh, origins, at_vertex, generator, parts=2 if tie else 4 if lattice else 0)


def _ball(count: int, generator) -> np.ndarray:
    """Points of a cube inside the ball of radius 0.3."""
    return (generator.random((count, 3)) - 0.5) * 0.34


def _lattice_origins(count: int, generator) -> np.ndarray:
    return generator.integers(1, 8, (count, 3)).astype(np.float64)


def _aim(mesh: Mesh, origins: np.ndarray, at_vertex: np.ndarray, generator, parts: int) -> Pairs:
    """Rays at random vertices or at points of random edges (at exact `parts` of them), and the faces around."""
    count = len(origins)
    vertex = generator.integers(len(mesh.vertices), size=count)
    edge = generator.integers(len(mesh.edges), size=count)
    along = generator.random(count)[:, None]
    if parts:
        along = np.round(along * parts) / parts
    a, b = (mesh.vertices[mesh.edges[edge, end]].astype(np.float64) for end in (0, 1))
    target = np.where(at_vertex[:, None], mesh.vertices[vertex], a + along * (b - a))
    directions = (target - origins).astype(np.float32)
    aim = np.where(at_vertex, vertex, len(mesh.vertices) + edge)
    start, sizes = mesh.around_start[aim], mesh.around_start[aim + 1] - mesh.around_start[aim]
    ray = np.repeat(np.arange(count, dtype=np.int32), sizes)
    place = np.arange(len(ray)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    triangle = mesh.around[np.repeat(start, sizes) + place]
    limit = np.full(count, np.inf, np.float32)
    return Pairs(Rays(origins, directions, limit), mesh.triangles, ray, triangle)
