"""Plans and published figures: `sweeps.toml`, `claims.toml`, `published.toml`."""

from __future__ import annotations
