"""How far a diagnosis of single axes comes on a mirror whose three actuators all act at once.

The fine steering mirror of CubeSpec was recorded by Floren et al. (ISMA-USD 2024, pages 2042-2052): three piezo inputs,
three displacements, orthogonal multisines at three levels, CC BY 4.0. Every input moves every output, so that no raw
channel is an axis. Here the three strongest modes are made axes: what a linear response of all channels says of
everything else is taken out, the residual is turned into modal coordinates, each mode is diagnosed by itself, and the
predictions are turned back::

    python -m studies.steering_mirror FOLDER [--out DIR]

`FOLDER` holds the arrays ``u_100mV_test.npy``, ``y_100mV_test.npy`` and so on of the repository
merijnfloren/fsm-benchmark-data; by default ``steering-mirror`` in the folder that `FLEXDESIGN_RECORDINGS` names.
"""
