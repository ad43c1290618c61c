"""The folder for what can be made again: generated scenes, logs of failed builds."""

from __future__ import annotations

import os
from pathlib import Path

from platformdirs import user_cache_dir


def cache_folder() -> Path:
    """DEFRAY_CACHE, else the user's cache folder; it need not exist."""
    return Path(os.environ.get("DEFRAY_CACHE") or user_cache_dir("defray"))
