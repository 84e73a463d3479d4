"""Runs: recorded experiments in CSV or Parquet files, and what ``measurements.toml`` beside them says about each.

A recording comes as it is: with gaps, times that jitter, a sensor that saturates. Reading it goes down these modules:
`clock` puts its rows in order, `faults` finds the readings that cannot be believed, `clock` then gives them a uniform
time, and `bridging` closes short gaps of the command. `description` reads ``measurements.toml``, `splitting` chooses
what is kept for validation, `suspicion` compares with a model. `frequency_response` reads the other kind of recording.
"""

from flexdesign.runs.description import NAME as DESCRIPTION
from flexdesign.runs.description import Measurements, read_measurements
from flexdesign.runs.frequency_response import FrequencyResponse, split_lines
from flexdesign.runs.reading import (
    ALLOWED,
    FEWEST,
    read_frequency_response,
    read_recordings,
    read_run,
    read_runs,
    write_run,
)
from flexdesign.runs.run import AXES, COMMANDS, Array, Between, CommandIs, Role, Run, Sensor
from flexdesign.runs.splitting import split
from flexdesign.runs.suspicion import refuse_wrong_units, suspicions

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
    "split",
    "split_lines",
    "suspicions",
    "write_run",
]
