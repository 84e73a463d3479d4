"""A publication reproduced: every printed number beside ours, with a verdict."""

from flexdesign.reproduction.course import Reproduction, reproduce
from flexdesign.reproduction.items import VERDICTS, Item

__all__ = ["VERDICTS", "Item", "Reproduction", "reproduce"]
