"""From a scene to an output folder: the one place that knows every stage."""

from gpusim.pipeline.running import run

__all__ = ["run"]
