"""Applications: files in, results and files out; the command line calls them, and so may programs.

Its modules:

- `correlation_output`: How pictures are correlated, and what is written of each of them and of all.
- `correlation`: Pictures of a surface correlated, by one camera or two.
- `advice`: Settings advised for a picture file, and why written as a page.
- `calibration`: Cameras calibrated from pictures of a board.
- `deck_results`: What files and reports tell of modes, buckling and motion.
- `decks`: The steps of an input deck solved.
- `field_scene`: The scene of a displacement file alone.
- `identification`: Modes identified in a video, and what was found written.
- `magnification`: A video in which the motions of some frequencies are larger.
"""

from gpusim.applications.advice import advise_files
from gpusim.applications.calibration import CalibrationOutput, calibrate_files
from gpusim.applications.correlation import correlate_files, correlate_pairs
from gpusim.applications.correlation_output import CorrelationOutput, CorrelationSettings
from gpusim.applications.decks import DeckOutput, solve_deck
from gpusim.applications.identification import (
    IdentificationOutput,
    IdentificationSettings,
    identify_files,
)
from gpusim.applications.magnification import magnify_files

__all__ = [
    "CalibrationOutput",
    "CorrelationOutput",
    "CorrelationSettings",
    "DeckOutput",
    "IdentificationOutput",
    "IdentificationSettings",
    "advise_files",
    "calibrate_files",
    "correlate_files",
    "correlate_pairs",
    "identify_files",
    "magnify_files",
    "solve_deck",
]


def __dir__() -> list[str]:
    return sorted(__all__)
