"""The paper's tracer: walk, bin, intersect, compact, wave after wave."""
