"""Which structure and options: sample, cost model, fit, choice."""
