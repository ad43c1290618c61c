"""A plan carried out: order, lock, resume, time left, executors."""
