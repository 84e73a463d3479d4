"""The noise floor of recorded runs: what no model can predict, measured where nothing but noise should be there.

In this order: quiet stretches, where every command stands still and modes have rung down; the difference of periods,
where a command repeats itself; the difference of runs with one and the same command. It is never taken from the
residual of a model, or whitening would swallow the physics that the model lacks. Frequency responses have their own,
line by line: see `lines`.
"""

from flexdesign.measurements.noise_level.lines import LineNoise, Mixed, line_noise
from flexdesign.measurements.noise_level.noise_floor import NoiseFloor, allowed_excess, noise_floor

__all__ = ["LineNoise", "Mixed", "NoiseFloor", "allowed_excess", "line_noise", "noise_floor"]
