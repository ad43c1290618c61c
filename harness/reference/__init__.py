"""Who is right: Embree, exact arithmetic, and the check of hits."""
