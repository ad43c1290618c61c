"""Plans and published figures: `sweeps.toml`, `accuracy.toml`, `claims.toml`, `published.toml`."""

from __future__ import annotations
