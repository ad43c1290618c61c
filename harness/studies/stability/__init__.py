"""Stress tests of intersectors, of the grid and of ray offsets: where methods fail, and by how much."""

from __future__ import annotations
