"""Stand-ins beside the real scenes: how like they are, and what they cost to make."""
