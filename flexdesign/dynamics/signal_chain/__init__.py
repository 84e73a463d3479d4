"""The signal chain of an axis: blocks in a row, compiled, integrated step by step."""
