"""From a scene to an output folder: the one place that knows every stage."""

from gpusim.pipeline.work import run

__all__ = ["run"]
