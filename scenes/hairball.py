"""Hairball: thin curled tubes about a ball (Samuli Laine); only its stand-in exists here."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(name="hairball", title="Hairball", triangles=2_880_000, paper=True)
