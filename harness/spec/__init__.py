"""What a run is, as text and data, before anything is loaded."""
