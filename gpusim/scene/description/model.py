"""Every table's class by its name.

A table's class has the keys of the file under their names, in the units that these say, and their
values in SI (m, s, N, Pa, kg, W, rad) under the same names without unit. World axes are
right-handed. Directions are as in the file, not normalised. A pattern's ``up`` (projected into the
plane of the faces it falls on, seen from outside) is None for +z, or +y on a plane that is
horizontal.
"""

from gpusim.scene.tables.table import Vec3

from .analysis.analysis_table import AnalysisTable
from .analysis.loads import (
    Amplitude,
    CentrifugalTable,
    ForceTable,
    GravityTable,
    LineForceTable,
    Load,
    LoadTable,
    NodalForceTable,
    PressureTable,
    SupportTable,
    ThermalTable,
    TieTable,
    TractionTable,
    WhereTable,
)
from .analysis.statics import StaticTable
from .analysis.transient import TransientTable
from .analysis.vibrations import OscillationTable
from .camera import CameraTable
from .correlation_measures import (
    CorrelationTable,
    ExtensometerTable,
    GaugeTable,
    LineMeasureTable,
    PointMeasureTable,
    SeriesTable,
)
from .ground import PaintedTable, PatternedTable
from .lens import LensTable, Psf, ShutterTable, VignettingTable
from .lights import (
    AmbientTable,
    AreaTable,
    EnvironmentTable,
    Light,
    LightTable,
    PointTable,
    SpotTable,
    SunTable,
)
from .material import FLOWING, NO_FLOW, MaterialTable
from .measure_table import MeasureTable
from .measures import (
    AnyMeasure,
    DamageTable,
    DeflectionTable,
    DicTable,
    MarkerMeasureTable,
    PublishedTable,
    RegionTable,
    StereoTable,
)
from .mesh import (
    BeamMeshTable,
    BoxMeshTable,
    BracketMeshTable,
    CraneMeshTable,
    FieldMeshTable,
    FileMeshTable,
    MeshRecipe,
    MeshTable,
    NotchRecipeTable,
    PlateMeshTable,
)
from .paint import (
    CheckerTable,
    DotsTable,
    Marker,
    MarkersTable,
    Paint,
    PaintTable,
    Pattern,
    PictureTable,
    PlainTable,
    SpeckleTable,
)
from .processing import (
    OutputTable,
    RenderTable,
    SolverTable,
    VariantTable,
)
from .prop import BoxTable, CalibrationTable, PlateTable, PoseTable, Prop, PropTable, ShapeTable
from .scene_table import Body, Part, SceneTable
from .sensor import CameraSensorTable, Gains, SensorTable
from .targets import ArucoTable, CharucoTable, CirclesTable, LinesTable, RingCodesTable, StarTable
