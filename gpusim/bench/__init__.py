"""Benchmarks and the stability suite: ``gpusim bench NAME``."""
