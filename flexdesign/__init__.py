"""flexdesign: design piezo-driven flexure stages, simulate them, and confront the model with measurements."""

__version__ = "0.1.0"
