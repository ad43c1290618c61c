"""Opened, warmed up, interleaved, checked: the only place that times."""
