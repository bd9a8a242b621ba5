"""Run time of images against their error, beside other renderers."""
