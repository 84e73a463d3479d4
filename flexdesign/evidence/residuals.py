"""Names that moved to `flexdesign.evidence.suite`."""

from flexdesign.evidence.suite import MOVED, Map

__all__ = ["MOVED", "Map"]
