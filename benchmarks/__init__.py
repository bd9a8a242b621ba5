"""Programs that draw run time against error; each runs as ``python -m benchmarks.NAME``."""
