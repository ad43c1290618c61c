"""defray: the benchmark harness for deferred ray tracing."""

__version__ = "0.1.0"
