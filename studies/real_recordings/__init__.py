"""Recordings measured by others, diagnosed from a simple model that a user would write::

    python -m studies.real_recordings FOLDER           # FOLDER holds positioning-drive/, piezo-loops/, ...
    python -m studies.real_recordings FOLDER --vary    # begin with other models and with shorter recordings, too

The recordings may not be kept with the project; each folder that is there is diagnosed. The table says what was named,
and the error on validation runs before and after.
"""
