"""A mechanism between one input and one output: what follows from the compliance between the two."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray


class TwoPort(ABC):
    """Stiffness and amplification of a closed form that knows its compliance."""

    @abstractmethod
    def port_compliance(self) -> NDArray[np.float64]:
        """Compliance between input (0) and output port (1), 2 by 2 and symmetric [m/N]."""

    @property
    def amplification(self) -> float:
        """Output travel over actuator extension, output free; positive inwards (convex bridge)."""
        compliance = self.port_compliance()
        return float(compliance[1, 0] / compliance[0, 0])

    @property
    def input_stiffness(self) -> float:
        """K_in, output free [N/m]."""
        return float(1 / self.port_compliance()[0, 0])

    @property
    def output_stiffness(self) -> float:
        """K_out, input free [N/m]."""
        return float(1 / self.port_compliance()[1, 1])
