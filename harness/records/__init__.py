"""Rows on disk: schemas, digests, files, machines."""
