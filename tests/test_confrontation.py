"""A model set beside recordings by hand: effects added and taken out, numbers moved, and what is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import flexdesign as fd
from flexdesign.api.confrontation import Confrontation
from flexdesign.diagnosis.confrontation import Confronted
from flexdesign.workbench import charts

ROOT = Path(__file__).parent.parent
DEMO = ROOT / "studies" / "hidden_effect_demo"
HIDDEN = "stress_stiffening"


@pytest.fixture(scope="module")
def begun() -> tuple[Confrontation, Confronted]:
    """A session, and the first answer to a tick in it."""
    made = fd.confront(DEMO / "model.toml", DEMO / "runs")
    return made, made.fit([HIDDEN], roughly=True)


@pytest.fixture(scope="module")
def session(begun: tuple[Confrontation, Confronted]) -> Confrontation:
    return begun[0]


def test_the_effect_that_was_hidden_brings_the_error_to_the_noise(session: Confrontation) -> None:
    """The recordings were simulated with it, and with numbers that answer.toml states."""
    before, found = session.fit(), session.fit([HIDDEN])
    assert session.designed().ratio > before.ratio > 50
    assert found.ratio < 1.15 and not found.reason
    assert [step.label for step in found.error_ladder] == ["as designed", "recalibrated", f"+ {HIDDEN}"]
    truth = tomllib.loads((DEMO / "answer.toml").read_text(encoding="utf-8"))
    every = session.engine.values([HIDDEN])
    assert every[-1].parameter.name == f"{HIDDEN}.cubic"  # the numbers of the model come first
    (value,) = [v for v in every if v.parameter.name == f"{HIDDEN}.cubic"]
    stated = float(truth["effects"][HIDDEN]["cubic"])
    half = (value.interval[1] - value.interval[0]) / 2
    assert abs(value.value - stated) < 2 * half  # 95 % of fits are within one


def test_a_rough_fit_comes_first_and_is_carried_to_its_end(begun: tuple[Confrontation, Confronted]) -> None:
    """It explains the residual already, with a larger chi^2; a fit to the end is kept."""
    session, rough = begun
    session.fit()
    assert HIDDEN in [offer.name for offer in session.offers() if offer.share is None]
    found = session.fit([HIDDEN])
    assert rough.is_rough and not found.is_rough
    assert rough.ratio < 1.15
    assert sum(squares(rough)) > sum(squares(found))
    assert not session.fit([HIDDEN], roughly=True).is_rough


def squares(found: Confronted) -> list[float]:
    """Return the mean square residual of each fitted run over that of its noise."""
    return [run.ratio**2 for run in found.compared_runs if run.role == "identify"]


def test_a_long_curve_keeps_the_largest_and_the_least_of_each_stretch() -> None:
    rng = np.random.default_rng(3)
    time, values = np.arange(10_007) * 1e-4, rng.normal(size=10_007)
    values[2000:2600] = np.nan
    shown = charts._points(time, values)
    assert len(shown) <= charts.POINTS
    kept = np.array([np.nan if v is None else v for _, v in shown])
    stretch = 17  # ceil(10007 / 600)
    for begin in range(0, len(values), stretch):
        part, there = values[begin : begin + stretch], time[begin : begin + stretch]
        inside = kept[[there[0] - 1e-9 <= t <= there[-1] + 1e-9 for t, _ in shown]]
        if np.isfinite(part).any():
            ends = np.nanmin(part), np.nanmax(part)
            assert (np.nanmin(inside), np.nanmax(inside)) == pytest.approx(ends, abs=1e-4)  # five digits
        else:
            assert np.isnan(inside).all()
    assert [t for t, _ in shown] == sorted(t for t, _ in shown)


def test_taking_an_effect_out_brings_the_model_back(session: Confrontation) -> None:
    before = session.fit()
    session.fit([HIDDEN])
    again = session.fit()
    assert again.effects == () and again.error == before.error
    assert [s.value for s in again.settings] == [s.value for s in before.settings]


def test_a_number_set_by_hand_moves_the_residual_and_back(session: Confrontation) -> None:
    found = session.fit([HIDDEN])
    gain = next(s for s in found.settings if s.parameter.name == "gain")
    assert gain.low < gain.value < gain.high
    same = session.simulate([HIDDEN], {"gain": gain.value})
    assert same.ratio == pytest.approx(found.ratio, rel=0.02)  # coarse steps: errors far below the noise
    off = session.simulate([HIDDEN], {"gain": 1.01 * gain.value})
    assert off.ratio > 5 * found.ratio and off.error_ladder[-1].label == "set by hand"
    # One percent of the motion is missing, but for its offset: the residual has its shape.
    run = next(r for r in off.comparison.runs if r.role == "validate")
    assert np.corrcoef(run.residual, run.measured)[0, 1] < -0.95


def test_traces_are_what_was_measured_in_readable_units(session: Confrontation) -> None:
    found = session.fit()
    recorded = {run.name: run for run in fd.read_recordings(DEMO / "runs")}
    traces = session.traces(found, "4-triangle")
    assert (traces.unit, traces.fine) == ("µm", "nm")
    assert traces.measured * 1e-6 == pytest.approx(np.asarray(recorded["4-triangle"].columns["x"]), abs=1e-12)
    assert traces.residual == pytest.approx(1e3 * (traces.measured - traces.modelled), abs=1e-6)
    with pytest.raises(KeyError, match="did you mean 4-triangle"):
        session.traces(found, "4-triangel")


def test_what_cannot_be_added_or_set_is_told(session: Confrontation) -> None:
    with pytest.raises(fd.InputError, match="effect = no_such: is in the model already, or these recordings"):
        session.fit(["no_such"])
    with pytest.raises(fd.InputError, match=r"gian = 1.0: is no number of this model; did you mean gain"):
        session.simulate([], {"gian": 1.0})
    with pytest.raises(fd.InputError, match="gain = nan: is not finite"):
        session.simulate([], {"gain": float("nan")})


def test_what_progress_raises_ends_a_fit_and_leaves_the_model_as_it_was(session: Confrontation) -> None:
    class Ended(Exception):
        pass

    def end(_: str) -> None:
        raise Ended

    before = session.fit()
    with pytest.raises(Ended):
        session.fit(["creep"], progress=end)
    assert session.fit().error == before.error


def test_the_report_has_ladder_and_model(session: Confrontation, tmp_path: Path) -> None:
    found = session.fit([HIDDEN])
    written = {path.name for path in session.result(found).report(tmp_path)}
    assert {"report.html", "report.md", "result.json", "stage_model.toml"} <= written
    assert "stress stiffening" in (tmp_path / "report.md").read_text(encoding="utf-8")
    better = fd.compare(tmp_path / "stage_model.toml", DEMO / "runs")
    assert better.rms < 1.05 * better.floor  # the model that is written predicts the runs


def test_formulas_answer_for_other_dimensions() -> None:
    """A thicker hinge is stiffer: by the cube of its thickness where it bends alone, by less beside other members."""
    thin, thick = (fd.formulas("bridge_amplifier", dimensions={"hinge_thickness": f"{t} mm"}) for t in (0.3, 0.33))
    ratio = thick["K_out_input_free"].value / thin["K_out_input_free"].value
    assert 1.1**2.5 < ratio < 1.1**3
    with pytest.raises(fd.InputError, match="hinge_thickness"):
        fd.formulas("bridge_amplifier", dimensions={"hinge_thickness": "900 mm"})
