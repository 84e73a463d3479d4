"""Mechanisms whose numbers are published: theirs and ours, and the effect that closes each gap."""

from flexdesign.workflows.published.compare_published import Compared, Mechanism, PublishedMechanisms, run
from flexdesign.workflows.published.folder import find

__all__ = ["Compared", "Mechanism", "PublishedMechanisms", "find", "run"]
