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
- `tracking`: Markers and points followed through a video, or a pair of them.
- `magnification`: A video in which the motions of some frequencies are larger.
"""

from gpusim.applications.advice import advise_files as advise_files
from gpusim.applications.calibration import CalibrationOutput as CalibrationOutput
from gpusim.applications.calibration import calibrate_files as calibrate_files
from gpusim.applications.correlation import correlate_files as correlate_files
from gpusim.applications.correlation import correlate_pairs as correlate_pairs
from gpusim.applications.correlation_output import CorrelationOutput as CorrelationOutput
from gpusim.applications.correlation_output import CorrelationSettings as CorrelationSettings
from gpusim.applications.decks import DeckOutput as DeckOutput
from gpusim.applications.decks import solve_deck as solve_deck
from gpusim.applications.identification import IdentificationOutput as IdentificationOutput
from gpusim.applications.identification import IdentificationSettings as IdentificationSettings
from gpusim.applications.identification import identify_files as identify_files
from gpusim.applications.magnification import magnify_files as magnify_files
from gpusim.applications.tracking import track_files as track_files
from gpusim.public_names import public_names as _public_names

__all__, __getattr__, __dir__ = _public_names(__name__)
