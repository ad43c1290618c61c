"""Real scenes from their publishers: downloaded, unpacked, pinned."""
