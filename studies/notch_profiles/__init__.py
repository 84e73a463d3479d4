"""Levers on hinges of every profile: finite elements and the compliance model, and what an accuracy of 1 % costs::

    python -m studies.notch_profiles

Each is the lever amplifier of geometry/sketches with a hinge of the same length and neck. Times are those of meshes and
solutions, over the time of a lever on a leaf that was solved in the same run.
"""
