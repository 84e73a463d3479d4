"""A publication reproduced: every printed number and ours, with a verdict."""

from flexdesign.workflows.reproduction.course import Reproduction, reproduce
from flexdesign.workflows.reproduction.items import VERDICTS, Item

__all__ = ["VERDICTS", "Item", "Reproduction", "reproduce"]
