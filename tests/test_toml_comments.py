"""A TOML file that the program changes keeps what its user wrote: comments, order, spelling."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

from flexdesign.core import toml_writing
from flexdesign.dynamics import stage_model

MODEL = """# Bench of the east room.
format = 1
[axis.x]
natural_frequency = "0.2 kHz"   # sine sweep of Monday
damping_ratio = 0.02            # log decrement
gain = "0.15 um/V"              # laser
uncertainty = { gain = "10 %" } # certificate

# The amplifier was repaired in May.
[axis.x.driver]
bandwidth = "1500 Hz"           # data sheet
"""


def model_with_creep(path: Path) -> stage_model.StageModel:
    model = stage_model.read(path)
    creep = {"creep": {"per_decade": 0.018, "t0": 0.1}}
    return replace(model, axes={"x": replace(model.axes["x"], damping_ratio=0.03, effects=creep)})


def test_an_added_effect_keeps_comments(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(MODEL, encoding="utf-8")
    better = model_with_creep(path)
    known = {"gain": 0.02, "creep.per_decade": 0.1}
    better = replace(better, axes={"x": replace(better.axes["x"], uncertainty=known)})
    text = stage_model.edit(path, better, tmp_path)
    for line in MODEL.splitlines():
        if not line.startswith(("damping_ratio", "uncertainty")):
            assert line in text.splitlines(), text
    (changed,) = (line for line in text.splitlines() if line.startswith("damping_ratio"))
    assert "0.03" in changed
    assert changed.endswith("# log decrement")
    (changed,) = (line for line in text.splitlines() if line.startswith("uncertainty"))
    assert changed.endswith("# certificate")
    (tmp_path / "again.toml").write_text(text, encoding="utf-8")
    assert stage_model.read(tmp_path / "again.toml").axes == better.axes


def test_a_model_in_memory_is_written_as_new(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(MODEL, encoding="utf-8")
    model = stage_model.read(path)
    assert stage_model.edit(model, model, tmp_path) == stage_model.to_toml(model, tmp_path)


def test_an_outdated_comment_of_the_program_goes() -> None:
    before = "a = 1  # assumed\nb = 2\n"
    after = "a = 3\nb = 2\n"
    assert toml_writing.merge(before, before, after).splitlines() == ["a = 3", "b = 2"]
    assert toml_writing.merge("a = 1  # mine\nb = 2 # too\n", before, after) == "a = 3  # mine\nb = 2 # too\n"


def test_a_removed_value_goes_and_its_neighbours_stay() -> None:
    original = "# head\n[t]\nx = 1 # gone\n# note\ny = 2\n"
    text = toml_writing.merge(original, "[t]\nx = 1\ny = 2\n", "[t]\ny = 2\n[u]\nz = 3\n")
    assert tomllib.loads(text) == {"t": {"y": 2}, "u": {"z": 3}}
    assert "# head" in text
    assert "# note" in text
