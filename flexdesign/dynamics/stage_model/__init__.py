"""The stage model: what geometry, data sheets and measurements say of a stage, axis by axis, in a file people can read.

`validate` and `identify` write it, `simulate` and `identify` read it. Each axis is a voltage-driven resonator,

    x = sum over modes of  share w^2 / (s^2 + 2 zeta w s + w^2) * (k_v v - h),

eqs (21) and (26) of Lin et al. (2019) with further modes, behind a driver and seen by a sensor. Mass, stiffness and
gain are those with the actuators installed: stack and seats in series, in place of a free input.
"""

from flexdesign.dynamics.stage_model.axis import ActuatorData, AxisModel, Contradiction, Driver, Mode, Sensor
from flexdesign.dynamics.stage_model.editing import edit
from flexdesign.dynamics.stage_model.model import ControllerTiming, Coupling, StageModel
from flexdesign.dynamics.stage_model.reading import find, read, with_overrides
from flexdesign.dynamics.stage_model.response_units import ResponseUnits
from flexdesign.dynamics.stage_model.writing import to_toml

__all__ = [
    "ActuatorData",
    "AxisModel",
    "Contradiction",
    "ControllerTiming",
    "Coupling",
    "Driver",
    "Mode",
    "ResponseUnits",
    "Sensor",
    "StageModel",
    "edit",
    "find",
    "read",
    "to_toml",
    "with_overrides",
]
