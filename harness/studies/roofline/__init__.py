"""How near kernels come to what the device can do."""
