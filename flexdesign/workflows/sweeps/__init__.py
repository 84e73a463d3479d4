"""Sweeps: one design in many versions, evaluated side by side, kept case by case, and the best of them picked.

`reading` makes a `plan` of a file that says what shall vary, `sampling` turns it into cases, one of the `evaluators`
answers for one case, `store` keeps every answer under the hash of its question, `running` has processes or a cluster do
the work, and `choosing` picks what keeps its limits.
"""

from flexdesign.workflows.sweeps.execution import Sweep, run
from flexdesign.workflows.sweeps.plan import SweepPlan
from flexdesign.workflows.sweeps.reading import is_sweep, read

__all__ = ["Sweep", "SweepPlan", "is_sweep", "read", "run"]
