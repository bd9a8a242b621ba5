"""What a run found: report.json, report.html and its figures.

In the order in which data passes:

- `model`: What a run found, as plain data.
- `findings`: Parts of that: mesh, forces and stress, errors.
- `text`: Numbers as a reader sees them, and as JSON has them.
- `stage_rows`: Stages as rows for readers: a camera's pictures that are alike are one row.
- `style`: One look for all figures.
- `figures`: Deflection line, convergence, tracked markers, errors.
- `measurement_figures`: A rig and its points in space, its calibration; states compared.
- `field_maps`: Measured fields beside true ones: maps, and their differences.
- `charts`: Curves of what was computed over one quantity.
- `figure_store`: Figures that are there from an earlier report.
- `html`: report.html: one self-contained page.
- `write`: report.json, figures and report.html in the output folder.
- `correlation`: The summary of a correlation: numbers, maps, what a page says.
- `advice`: Advice on settings: what it says in words and numbers, the curves it comes from, and a
  page.
"""

from gpusim.public_names import public_names as _public_names
from gpusim.report.charts import Chart as Chart
from gpusim.report.charts import draw_chart as draw_chart
from gpusim.report.findings import BodyForce as BodyForce
from gpusim.report.findings import Budget as Budget
from gpusim.report.findings import BudgetRow as BudgetRow
from gpusim.report.findings import Explanation as Explanation
from gpusim.report.findings import FieldPicture as FieldPicture
from gpusim.report.findings import LoadPath as LoadPath
from gpusim.report.findings import LoadStepRow as LoadStepRow
from gpusim.report.findings import Mechanics as Mechanics
from gpusim.report.findings import MeshSummary as MeshSummary
from gpusim.report.findings import PartSize as PartSize
from gpusim.report.findings import Published as Published
from gpusim.report.findings import StressPeak as StressPeak
from gpusim.report.model import Drawing as Drawing
from gpusim.report.model import Figure as Figure
from gpusim.report.model import Film as Film
from gpusim.report.model import FramePair as FramePair
from gpusim.report.model import Link as Link
from gpusim.report.model import Measurement as Measurement
from gpusim.report.model import Overlay as Overlay
from gpusim.report.model import Report as Report
from gpusim.report.model import Series as Series
from gpusim.report.model import SolutionSummary as SolutionSummary
from gpusim.report.model import Stage as Stage
from gpusim.report.model import Table as Table
from gpusim.report.write import ReportPaths as ReportPaths
from gpusim.report.write import write_report as write_report

__all__, __getattr__, __dir__ = _public_names(__name__)
