"""The Python face: one function for each command, and results that print and report themselves.

`import flexdesign as fd` offers all of it; see `flexdesign.__all__`.
"""
