"""Plans and published figures: `sweeps.toml`, `accuracy.toml`, `reproduce.toml`, `claims.toml`, `published.toml`."""

from __future__ import annotations
