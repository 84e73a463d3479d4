"""A stage with a hidden effect: six short recordings, the model that lacks it, and the answer in a file of its own.

The recordings are made by the simulator of the hidden-effect trial, which shares no code with the package::

    python -m studies.hidden_effect_demo [--out DIR]

makes them again, bit for bit. What is hidden stands in ``answer.toml``; `diagnose` is not given it.
"""
