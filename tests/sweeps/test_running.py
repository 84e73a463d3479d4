"""Sweeps that are killed, share a folder, lose a process or a worker: nothing but the cases in flight is lost."""

from __future__ import annotations

import csv
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from flexdesign.analytic import stage_compliance, static_model
from flexdesign.analytic.stage_compliance import StageCompliance
from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache
from flexdesign.design import design
from flexdesign.design.assembly import Element
from flexdesign.fem import mesh_refinement
from flexdesign.workflows import sweeps
from flexdesign.workflows.sweeps import execution, workers
from flexdesign.workflows.sweeps.evaluators import EvaluationRequest
from flexdesign.workflows.sweeps.store import STAGE, Store

ROOT = Path(__file__).parents[2]
CASES = 400
STUDY = f"""format = 1
design = "{ROOT / "geometry" / "lin2019_amplifier_xy.toml"}"
evaluator = "analytic"
[vary]
"dimensions.hinge_thickness" = {{ from = "0.3 mm", to = "0.8 mm" }}
"dimensions.arm_span" = {{ from = "15 mm", to = "30 mm" }}
[sample]
method = "sobol"
count = {CASES}
"""
#: A bridge amplifier whose formulas end the process where its hinges are thinner than half a millimetre.
DEADLY = f"""
import os, sys
sys.path.insert(0, {str(ROOT / "geometry")!r})
from bridge_amplifier import BridgeAmplifier as Bridge

class Deadly(Bridge):
    def formulas(self, material, actuator_stiffness, output_load):
        if self.hinge_thickness < 0.4e-3:
            os._exit(9)
        return super().formulas(material, actuator_stiffness, output_load)
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


def command(study: Path, out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "flexdesign", "sweep", str(study), "--out", str(out), *more]


def started(line: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        line,
        cwd=folder,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_hear_interrupts,
    )


def _hear_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which shells have their background jobs ignore


def kept(out: Path) -> int:
    """Return how many cases are there."""
    return sum(
        len((Cache(out).load(STAGE, p.stem) or ({}, {"keys": []}))[1]["keys"]) for p in (out / STAGE).glob("*.npz")
    )


def wait_for(condition: object, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def table(out: Path) -> list[dict[str, str]]:
    with (out / "cases.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_sweep_that_is_killed_goes_on_where_it_was(study: Path, tmp_path: Path) -> None:
    out, plan = tmp_path / "out", sweeps.read(study)
    process = started(command(study, out, "--jobs", "2"), tmp_path)
    wait_for(lambda: kept(out) > 0)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    done = kept(out)
    assert 0 < done < CASES
    assert not (out / "report.html").exists()
    found = sweeps.run(plan, Store(out), jobs=2)
    assert found.computed == CASES - done
    assert not found.failed
    whole = sweeps.run(plan, Store(tmp_path / "other"), jobs=1)
    for key, values in whole.results.values.items():
        assert found.results.values[key] == pytest.approx(values, rel=1e-12)
    assert sweeps.run(plan, Store(out)).computed == 0


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks Linux for the children of a process")
def test_workers_end_when_their_parent_was_killed(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = started(command(study, out, "--jobs", "2", "--set", f"sample.count={100 * CASES}"), tmp_path)
    wait_for(lambda: kept(out) > 0)
    workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert len(workers) >= 2
    process.kill()  # this one alone, and with no chance to end them
    process.communicate(timeout=20)  # ends once nobody has its pipes open
    wait_for(lambda: not any(_lives(pid) for pid in workers), 10.0)


def _lives(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_ctrl_c_keeps_what_is_done_and_says_so(study: Path, tmp_path: Path) -> None:
    out, many = tmp_path / "out", 100 * CASES  # some seconds of work: this process may have to wait its turn
    process = started(command(study, out, "--jobs", "1", "--set", f"sample.count={many}"), tmp_path)
    wait_for(lambda: kept(out) > 0)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    assert "interrupted" in said and "Traceback" not in said
    assert 0 < kept(out) < many


def test_two_sweeps_in_one_folder_at_once(study: Path, tmp_path: Path) -> None:
    out, other = tmp_path / "out", tmp_path / "other.toml"
    other.write_text(STUDY.replace('"15 mm"', '"16 mm"'))
    processes = [started(command(s, out, "--jobs", "1"), tmp_path) for s in (study, other)]
    for process in processes:
        _, said = process.communicate(timeout=120)
        assert process.returncode == 0, said
    assert kept(out) == 2 * CASES
    assert [sweeps.run(sweeps.read(s), Store(out)).computed for s in (study, other)] == [0, 0]


def test_a_finer_grid_computes_what_is_missing(tmp_path: Path) -> None:
    def grid(count: int) -> sweeps.SweepPlan:
        path = tmp_path / f"grid{count}.toml"
        path.write_text(
            re.sub(r"\[sample\].*", "", STUDY, flags=re.S).replace('"0.8 mm"', f'"0.8 mm", count = {count}')
        )
        return sweeps.read(path, ["evaluator=pseudo-rigid"])

    coarse = sweeps.run(grid(3), Store(tmp_path / "out"), jobs=1)
    fine = sweeps.run(grid(5), Store(tmp_path / "out"), jobs=1)
    assert (coarse.computed, fine.computed) == (15, 10)


def test_what_changes_an_answer_changes_its_key(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = sweeps.read(study)
    cases = plan.cases()[:2]
    first, second = (question.key for question in execution.requests_of(plan, cases))
    assert first != second
    for other in (
        sweeps.read(study, ["material=Ti-6Al-4V"]),
        sweeps.read(study, ["dimensions.width=19 mm"]),
        sweeps.read(study, ["evaluator=pseudo-rigid"]),
    ):
        assert execution.requests_of(other, cases)[0].key != first
    assert execution.requests_of(sweeps.read(study, ["sample.seed=7"]), cases)[0].key == first
    monkeypatch.setitem(execution.ANSWERING, "analytic", ("analytic/*.py",))
    assert execution.requests_of(plan, cases)[0].key != first


def test_the_sources_of_an_answer_are_files_that_are_there() -> None:
    """A place that names no file would let answers of other code pass for those of this one."""
    package = Path(execution.__file__).parents[2]
    places = {place for named in execution.ANSWERING.values() for place in named}
    assert [place for place in places if not any(package.glob(place))] == []
    stems = {path.stem for path in (package / "fem").rglob("*.py")}
    assert set(mesh_refinement.AFTERWARDS) <= stems


def test_a_case_that_cannot_be_built_is_recorded_and_stops_nothing(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace('"0.8 mm"', '"8 mm"'))
    found = sweeps.run(sweeps.read(path, ["sample.count=64"]), Store(tmp_path / "out"), jobs=2)
    thick = [case.values["dimensions.hinge_thickness"] > 0.9 * 4e-3 for case in found.cases]  # arms are 4 mm thick
    assert [bool(error) for error in found.results.errors] == thick
    assert any(thick) and not all(thick)
    assert all("a hinge is thinner than its arm" in found.results.errors[i] for i in found.failed)


def test_a_case_that_kills_its_process_is_recorded_and_takes_no_other_along(tmp_path: Path) -> None:
    (tmp_path / "deadly.py").write_text(DEADLY)
    content = (ROOT / "geometry" / "lin2019_amplifier_xy.toml").read_text()
    (tmp_path / "design.toml").write_text(content.replace('"bridge_amplifier"', '"deadly.py"'))
    path = tmp_path / "study.toml"
    vary = '"dimensions.hinge_thickness" = { from = "0.35 mm", to = "0.8 mm", count = 4 }'
    path.write_text(f'format = 1\ndesign = "design.toml"\n[vary]\n{vary}\n')
    found = sweeps.run(sweeps.read(path), Store(tmp_path / "out"), jobs=2)
    assert [bool(error) for error in found.results.errors] == [True] + 3 * [False]
    assert found.results.errors[0] == execution.DIED
    honest = sweeps.read(path)
    assert sweeps.run(honest, Store(tmp_path / "out")).computed == 0


def test_a_script_from_stdin_without_a_guard_sweeps_in_processes(study: Path, tmp_path: Path) -> None:
    """Worker processes do not run the script of their parent."""
    script = f"""
import flexdesign as fd

found = fd.sweep({str(study)!r}, ["sample.count=8"], store="answers", jobs=2)
print(found.computed, len(found.failed))
"""
    done = subprocess.run(
        [sys.executable, "-"], input=script, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("8 0\n", "")


# --- a cluster ----------------------------------------------------------------------------------------------------


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """A scheduler and two workers on loopback, each a process of its own."""
    pytest.importorskip("distributed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    dask = (
        [sys.executable, "-m", "distributed.cli.dask_scheduler"],
        [sys.executable, "-m", "distributed.cli.dask_worker"],
    )
    options = ["--no-dashboard"]
    lines = [
        [*dask[0], "--host", "127.0.0.1", "--port", str(port), *options],
        *([*dask[1], address, "--nthreads", "1", "--no-nanny", *options] for _ in range(2)),
    ]
    processes = [started(line, tmp_path) for line in lines]
    yield address, processes
    for process in processes:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def test_a_worker_of_a_cluster_that_dies_loses_nothing(
    study: Path, tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[str]]]
) -> None:
    address, (_, first, _) = cluster
    out, said = tmp_path / "out", list[str]()

    def watching(text: str) -> None:
        said.append(text)
        if first.poll() is None and " of 400 cases" in text:
            os.killpg(first.pid, signal.SIGKILL)

    found = sweeps.run(sweeps.read(study), Store(out), scheduler=address, progress=watching)
    first.communicate()
    assert first.returncode == -signal.SIGKILL
    assert found.computed == CASES and not found.failed
    here = sweeps.run(sweeps.read(study), Store(tmp_path / "here"), jobs=1)
    for key, values in here.results.values.items():
        assert found.results.values[key] == pytest.approx(values, rel=1e-12)


def test_a_worker_is_told_that_code_is_forbidden(tmp_path: Path) -> None:
    """Its environment is not that of the sweep; the next batch may run code again."""
    (tmp_path / "deadly.py").write_text(DEADLY)
    text = (ROOT / "geometry" / "bridge_amplifier.toml").read_text()
    file = tmp_path / "design.toml"
    file.write_text(text.replace('part = "bridge_amplifier"', 'part = "deadly.py"'))
    request = EvaluationRequest("key", file, (), {}, "analytic", {})
    assert "--no-code forbids its part to run" in workers._on_a_worker([request], without_code=True).errors[0]
    assert workers._on_a_worker([request], without_code=False).errors[0] == ""


def test_a_scheduler_that_is_not_there_is_named(study: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    done = subprocess.run(
        command(study, tmp_path / "out", "--scheduler", "tcp://127.0.0.1:1"),
        env={**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "--scheduler = tcp://127.0.0.1:1: no scheduler answers there" in done.stderr.splitlines()[-1]


def test_formulas_of_a_sweep_are_those_of_the_part(study: Path, tmp_path: Path) -> None:
    """Stroke and blocked force follow by superposition: held at half the stroke, the output pushes half as hard."""
    plan = sweeps.read(study, ["sample.count=4"])
    found = sweeps.run(plan, Store(tmp_path), jobs=1)
    base = design.read(ROOT / "geometry" / "lin2019_amplifier_xy.toml")
    assert base.actuator is not None
    k = base.actuator.installed_stiffness
    for place, case in enumerate(found.cases):
        changed = [f"{key}={1e3 * float(value):.15g} mm" for key, value in case.values.items()]
        formulas = design.read(base.file, changed).part().formulas(base.material, k, None)
        direct = {quantity.key: quantity.value for quantity in formulas["compliance"]}
        there = {quantity.key: quantity.value for quantity in found.results.at(place)}
        assert {key: there[key] for key in direct} == pytest.approx(direct, rel=1e-9)
        # The actuator between the inputs, with the output free: what a spring of its stiffness leaves of its extension.
        push = base.actuator.free_stroke / (1 / k + 1 / direct["K_in_output_free"])
        stroke = push / direct["K_in_output_free"] * direct["lambda_output_free"]
        assert there["stroke_output_free"] == pytest.approx(stroke, rel=1e-12)
        assert there["blocked_force_output_held"] / stroke == pytest.approx(direct["K_out_actuator_installed"])


def test_effects_of_a_design_vary(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.partition("[vary]")[0] + '[vary]\n"effects.over_cut.thinner" = ["0 um", "20 um"]\n')
    found = sweeps.run(sweeps.read(path), Store(tmp_path / "out"), jobs=1).results
    drawn = ROOT / "geometry" / "lin2019_amplifier_xy.toml"
    for place, thinner in enumerate(("0 um", "20 um")):
        alone = static_model.of_design(design.read(drawn, [f"effects.over_cut.thinner={thinner}"]))
        for key, quantity in alone.compliance({}).quantities().items():
            assert found.column(key)[place] == pytest.approx(quantity.value, rel=1e-12)
    assert found.column("K_in_output_free")[1] < 0.96 * found.column("K_in_output_free")[0]  # t^2.5, and t is 0.5 mm


def test_a_whole_stage_is_answered_for_by_its_formulas(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    text = STUDY.replace("lin2019_amplifier_xy", "lin2019_xyz_stage").partition("[vary]")[0]
    path.write_text(text + '[vary]\n"dimensions.limb_length" = ["45.5 mm", "50 mm"]\n')
    found = sweeps.run(sweeps.read(path), Store(tmp_path / "out"), jobs=1).results
    whole = design.read(ROOT / "geometry" / "lin2019_xyz_stage.toml", ["dimensions.limb_length=50 mm"])
    assembly, actuator = whole.stage().assembly(), whole.actuator
    assert actuator is not None
    model = StageCompliance.of_assembly(assembly, whole.material).having(stage_compliance.nominal_effects(assembly))
    k = actuator.installed_stiffness
    for axis, row in (("x", 0), ("z", 2)):
        push = np.array([assembly.axes[axis].drives.get(e.name, 0.0) for e in assembly.elements if _has_inputs(e)])
        table = len(push) + row  # actuators that push with k times their free stroke, springs k beside them
        travel = model.with_input_springs(k)[table, : len(push)] @ (k * actuator.free_stroke * push)
        assert found.column(f"stroke_{axis}_table_free")[1] == pytest.approx(travel, rel=1e-6)
        assert found.column(f"K_in_{axis}_table_free")[1] == pytest.approx(model.input_stiffness(axis), rel=1e-9)


def test_a_whole_stage_has_no_section(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    text = STUDY.replace("lin2019_amplifier_xy", "lin2019_xyz_stage").replace("arm_span", "limb_length")
    path.write_text(text.replace('"15 mm", to = "30 mm"', '"40 mm", to = "50 mm"'))
    assert sweeps.read(path, ["evaluator=fem"]).design.is_stage
    with pytest.raises(InputError, match="not of one section"):
        sweeps.read(path, ["evaluator=planar"])


def _has_inputs(element: Element) -> bool:
    return any(port.role == "input" for port in element.part.ports())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"dimensions.arm_span"', '"effects.over_cut.thinner"', "compliance model"),
        ('"dimensions.arm_span"', '"actuator.stifness"', "stiffness"),
    ],
)
def test_what_an_evaluator_does_not_know_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "study.toml"
    path.write_text(STUDY.replace("analytic", "fem").replace(old, new))
    with pytest.raises(InputError, match=said) as refused:
        sweeps.read(path)
    assert refused.value.file == str(path)
