"""Trajectories: what is commanded over time, described by a shape and its numbers, or by a file.

>>> table = {"shape": "step", "start": "0 um", "target": "10 um", "wait": "1 ms", "hold": "2 ms"}
>>> Trajectory.model_validate(table).sampled(1e-3) * 1e6
array([ 0., 10., 10., 10.])
"""

from flexdesign.dynamics.trajectories.base import Level, Trajectory, shapes
from flexdesign.dynamics.trajectories.moves import Hold, Line, Staircase, Step
from flexdesign.dynamics.trajectories.recorded import Recorded
from flexdesign.dynamics.trajectories.waves import Chirp, Multisine, Sine, Square, Triangle

__all__ = [
    "Chirp",
    "Hold",
    "Level",
    "Line",
    "Multisine",
    "Recorded",
    "Sine",
    "Square",
    "Staircase",
    "Step",
    "Trajectory",
    "Triangle",
    "shapes",
]
