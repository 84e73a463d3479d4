"""Types of arrays, for annotations: of numbers, of flags, and of places in other arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Places = NDArray[np.intp]
