"""Runs: recorded experiments in CSV or Parquet files, and their description in ``measurements.toml`` next to them.

A recording comes as it is: with gaps, times that jitter, a sensor that saturates. Reading it goes down these modules:
`clock` puts its rows in order, `faults` finds the readings that cannot be believed, `clock` then gives them a uniform
time, and `bridging` closes short gaps of the command. `description` reads ``measurements.toml``, `splitting` chooses
what is kept for validation, `suspicion` compares with a model. `frequency_response` reads the other kind of recording.
"""

from flexdesign.core.arrays import Array
from flexdesign.measurements.recordings.description import NAME as DESCRIPTION
from flexdesign.measurements.recordings.description import Measurements, read_measurements
from flexdesign.measurements.recordings.frequency_response import FrequencyResponse, split_lines
from flexdesign.measurements.recordings.reading import (
    ALLOWED,
    FEWEST,
    read_frequency_response,
    read_recordings,
    read_run,
    read_runs,
    runs_alone,
    write_run,
)
from flexdesign.measurements.recordings.run import AXES, COMMANDS, Between, CommandIs, Role, Run, Sensor
from flexdesign.measurements.recordings.splitting import split
from flexdesign.measurements.recordings.unit_check import refuse_wrong_units, suspicions

__all__ = [
    "ALLOWED",
    "AXES",
    "COMMANDS",
    "DESCRIPTION",
    "FEWEST",
    "Array",
    "Between",
    "CommandIs",
    "FrequencyResponse",
    "Measurements",
    "Role",
    "Run",
    "Sensor",
    "read_frequency_response",
    "read_measurements",
    "read_recordings",
    "read_run",
    "read_runs",
    "refuse_wrong_units",
    "runs_alone",
    "split",
    "split_lines",
    "suspicions",
    "write_run",
]
