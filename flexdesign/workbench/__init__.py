"""The workbench: a local page that drives the Python face; it computes nothing itself."""
