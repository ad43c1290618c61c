"""One OpenCL device: found, opened, described, programmed, timed."""
