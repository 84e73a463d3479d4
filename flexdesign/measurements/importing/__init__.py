"""Recordings of other programs brought into a folder of runs, as a map says.

`readers` opens a file and says what variables it holds; `template` proposes a map; `mapping` reads one; `assembling`
makes runs of the variables; `folder` writes them beside a ``measurements.toml``.
"""

from flexdesign.measurements.importing.contents import Contents, Variable
from flexdesign.measurements.importing.folder import Imported, bring_in
from flexdesign.measurements.importing.readers import look
from flexdesign.measurements.importing.template import propose, template

__all__ = ["Contents", "Imported", "Variable", "bring_in", "look", "propose", "template"]
