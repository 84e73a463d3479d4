"""Contents of recordings, what is suspicious, and the effects a diagnosis can identify: no model is needed.

`coverage` says which kinds of experiment the recordings are and which effects these reveal; `suspicion` looks for what
would mislead a fit; `timing` for what happens between samples; `tables` for what does not go together in static tables;
`checking` puts them together.
"""

from flexdesign.diagnosis.check.checking import Channel, Check, Recorded, check
from flexdesign.diagnosis.check.coverage import Coverage
from flexdesign.diagnosis.check.tables import facts, is_table

__all__ = ["Channel", "Check", "Coverage", "Recorded", "check", "facts", "is_table"]
