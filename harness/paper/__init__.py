"""Plans and published figures: `sweeps.toml`, `claims.toml`, `published.toml`."""
