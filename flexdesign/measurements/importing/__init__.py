"""Recordings of other programs brought into a folder of runs, as a map says.

`readers` opens a file and says what variables it holds. `guessing` assigns them to columns, by `roles` and
`header_cells`; `template` writes that as a map, and asks for what nobody can know. `mapping` reads a map; `assembling`
makes runs of the variables; `folder` writes them with a ``measurements.toml``.
"""

from flexdesign.measurements.importing.contents import Contents, Variable
from flexdesign.measurements.importing.folder import Imported, bring_in
from flexdesign.measurements.importing.mapping import Map, parse_map
from flexdesign.measurements.importing.readers import list_files, read_contents
from flexdesign.measurements.importing.template import Proposal, asking, proposal, propose, template

__all__ = [
    "Contents",
    "Imported",
    "Map",
    "Proposal",
    "Variable",
    "asking",
    "bring_in",
    "list_files",
    "parse_map",
    "proposal",
    "propose",
    "read_contents",
    "template",
]
