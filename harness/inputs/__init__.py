"""Everything a run is given: scenes and rays."""
