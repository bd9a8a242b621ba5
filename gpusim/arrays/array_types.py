"""Names for arrays by the kind of their numbers; docstrings give shapes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]
Real = npt.NDArray[np.floating]
"""float64 or float32."""
Complex = npt.NDArray[np.complex128]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]
