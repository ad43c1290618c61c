"""One question each: how its rows are measured."""
