"""Every table's class by its name.

A table's class has the keys of the file under their names, in the units that these say, and their
values in SI (m, s, N, Pa, kg, W, rad) under the same names without unit. World axes are
right-handed. Directions are as in the file, not normalised. A pattern's ``up`` (projected into the
plane of the faces it falls on, seen from outside) is None for +z, or +y on a plane that is
horizontal.
"""

from .camera import *
from .ground import *
from .lens import *
from .lights import *
from .loads import *
from .material import *
from .measure_table import MeasureTable as MeasureTable
from .measures import *
from .mesh import *
from .paint import *
from .processing import *
from .prop import *
from .scene_table import *
from .sensor import *
from .table import Vec3 as Vec3
from .targets import *
