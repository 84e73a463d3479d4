"""The bench: command files within an axis' limits, effect signatures, and which distinguish two effects."""
