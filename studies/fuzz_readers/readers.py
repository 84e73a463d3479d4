"""What is read: for each reader the files of a folder, which of them are damaged, and how the program reads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from studies.fuzz_readers import seeds

if TYPE_CHECKING:
    from flexdesign.analytic.static_model import StaticModel

#: Makes the content of a file, once.
Make = Callable[[], bytes]


@dataclass(frozen=True)
class Reader:
    """A reader of files.

    Parameters
    ----------
    read
        Reads what is in a folder.
    files
        What is there, by name.
    damaged
        Which of them are damaged, and as what: see `mutations.WAYS`.
    """

    read: Callable[[Path], object]
    files: Mapping[str, Make]
    damaged: Mapping[str, str]


def _design(folder: Path) -> object:
    from flexdesign.design import study

    found = study.read(folder / "design.toml")
    return found.design.part() if not found.design.is_stage else found.design.stage().assembly()


def _study(folder: Path) -> object:
    from flexdesign.design import study

    return study.read(folder / "study.toml")


def _stage_study(folder: Path) -> object:
    from flexdesign.design import study
    from flexdesign.workflows.validation.stage_published import read_published

    found = study.read(folder / "study.toml")
    return read_published(found, found.design.stage().assembly())


def _material(folder: Path) -> object:
    from flexdesign.design.materials.library import read

    return read(folder / "material.toml")


def _sweep(folder: Path) -> object:
    from flexdesign.workflows import sweeps

    return sweeps.read(folder / "sweep.toml")


def _targets(folder: Path) -> object:
    from flexdesign.analytic import dimension_synthesis

    return dimension_synthesis.size(folder / "targets.toml").to_toml()


def _stage_model(folder: Path) -> object:
    from flexdesign.dynamics import stage_model

    return stage_model.to_toml(stage_model.read(folder / "model.toml"), folder)


def _overrides(folder: Path) -> object:
    from flexdesign.dynamics import stage_model

    lines = (folder / "overrides.txt").read_bytes().decode(errors="replace").split("\n")
    return stage_model.read(folder / "model.toml", [line for line in lines if line])


def _experiments(folder: Path) -> object:
    from flexdesign.dynamics import experiments, stage_model

    plan = experiments.read(folder / "experiments.toml", ["x", "y", "z"])
    for each in plan.experiments:
        each.trajectory.sampled(1e-3)
    model = folder / "model.toml"
    return experiments.variants(plan, lambda changes: stage_model.read(model, changes))


def _recordings(folder: Path) -> object:
    from flexdesign.measurements import recordings

    found = recordings.read_recordings([folder])
    return recordings.split([each for each in found if isinstance(each, recordings.Run)])


def _static(folder: Path) -> object:
    from flexdesign.analytic import static_model
    from flexdesign.diagnosis.comparison import static_table

    model = _bridge()
    return static_table.compare(model, static_model.read([folder / "table.csv"], model.design))


@cache
def _bridge() -> StaticModel:
    from flexdesign.analytic import static_model
    from flexdesign.design import design

    return static_model.of_design(design.read(design.find("bridge_amplifier")))


def _import_reader(name: str) -> Callable[[Path], object]:
    """Return what looks into a file, proposes a map, and brings the file in as another one says."""

    def read(folder: Path) -> object:
        from flexdesign.measurements import importing

        importing.template(importing.read_contents([folder / name]))
        return importing.bring_in([folder / name], folder / "map.toml", folder / "out")

    return read


def _by_map(folder: Path) -> object:
    from flexdesign.measurements import importing

    return importing.bring_in([folder / "data.txt"], folder / "map.toml", folder / "out")


def _sweep_results(folder: Path) -> object:
    from flexdesign.workflows.sweeps.store import Store

    (folder / "cases").mkdir(exist_ok=True)
    (folder / "cases" / "kept.npz").write_bytes((folder / "kept.npz").read_bytes())
    return Store(folder).refresh()


def _package_file(name: str) -> Make:
    return lambda: seeds.package_file(name)


def _map(u: str, x: str, channels: tuple[int, int] = (1, 1)) -> Make:
    """Return a map of two variables, or of channels of them."""
    text = seeds.SHORT_MAP.replace("NAME_u", u).replace("NAME_x", x)
    for place, channel in zip(("CHANNEL_u", "CHANNEL_x"), channels, strict=True):
        text = text.replace(place, f"channel = {channel}")
    return lambda: text.encode()


def _text(data: bytes) -> Make:
    return lambda: data


def _of(read: Callable[[Path], object], damaged: str, as_what: str, content: Make, **others: Make) -> Reader:
    """Return a reader of one damaged file; those next to it are named without their ending .toml."""
    return Reader(read, {damaged: content, **{f"{n}.toml": make for n, make in others.items()}}, {damaged: as_what})


def _binary(name: str, content: Make, u: str, x: str, channels: tuple[int, int] = (1, 1)) -> Reader:
    return _of(_import_reader(name), name, "binary", content, map=_map(u, x, channels))


_STAGE, _MODEL = _package_file("studies/lin2019_stage.toml"), _text(b"format = 1\n" + seeds.AXIS)
_RUN, _LINES = _text(seeds.RUN), _text(seeds.LINES)
READERS: dict[str, Reader] = {
    "design": _of(_design, "design.toml", "toml", _text(seeds.DESIGN)),
    "stage-design": _of(_design, "design.toml", "toml", _package_file("geometry/lin2019_xyz_stage.toml")),
    "study": _of(_study, "study.toml", "toml", _text(seeds.STUDY), design=_text(seeds.DESIGN)),
    "stage-study": _of(_stage_study, "study.toml", "toml", _package_file("studies/table1.toml")),
    "material": _of(_material, "material.toml", "toml", _text(seeds.MATERIAL)),
    "sweep": _of(_sweep, "sweep.toml", "toml", _text(seeds.SWEEP)),
    "sweep-simulated": _of(_sweep, "sweep.toml", "toml", _package_file("studies/payload_and_damping.toml")),
    "targets": _of(_targets, "targets.toml", "toml", _package_file("studies/lin2019_targets.toml")),
    "stage-model": _of(_stage_model, "model.toml", "toml", _STAGE),
    "stage-model-full": _of(_stage_model, "model.toml", "toml", _MODEL),
    "overrides": _of(_overrides, "overrides.txt", "toml", _text(seeds.OVERRIDES), model=_STAGE),
    "experiments": Reader(
        _experiments,
        {"experiments.toml": _text(seeds.EXPERIMENTS), "command.csv": _text(seeds.FOLLOWED), "model.toml": _STAGE},
        {"experiments.toml": "toml", "command.csv": "table"},
    ),
    "experiments-shipped": _of(
        _experiments, "experiments.toml", "toml", _package_file("studies/lin2019_experiments.toml"), model=_STAGE
    ),
    "measurements": Reader(
        _recordings,
        {
            "measurements.toml": _text(seeds.MEASUREMENTS),
            "run.csv": _text(seeds.RUN),
            "response.csv": _text(seeds.LINES),
        },
        {"measurements.toml": "toml"},
    ),
    "run": _of(_recordings, "run.csv", "table", _RUN),
    "run-parquet": _of(_recordings, "run.parquet", "binary", seeds.parquet),
    "frequency-response": _of(_recordings, "response.csv", "table", _LINES),
    "static-table": _of(_static, "table.csv", "table", _text(seeds.STATIC)),
    "map": Reader(_by_map, {"map.toml": _text(seeds.MAP), "data.txt": _text(seeds.TEXT)}, {"map.toml": "toml"}),
    "import-text": _of(_import_reader("data.txt"), "data.txt", "table", _text(seeds.TEXT), map=_map("u", "x")),
    "import-mat": _binary("rig.mat", seeds.matlab, "rig.u", "rig.x"),
    "import-mat-packed": _binary("rig.mat", seeds.matlab_compressed, "rig.u", "rig.x"),
    "import-mat-73": _binary("rig.mat", seeds.matlab_73, "rig.u", "rig.x"),
    "import-hdf5": _binary("rig.h5", seeds.hdf5, "bench/u", "bench/x"),
    "import-tdms": _binary("rig.tdms", seeds.tdms, "bench/u", "bench/x"),
    "import-uff": _binary("rig.uff", seeds.universal, "set1", "set2"),
    "import-uff-text": _of(_import_reader("rig.uff"), "rig.uff", "table", seeds.universal, map=_map("set1", "set2")),
    "import-npy": _binary("rig.npy", seeds.numpy_array, "rig", "rig", (1, 2)),
    "import-npz": _binary("rig.npz", seeds.numpy_archive, "u", "x"),
    "answers": _of(_sweep_results, "kept.npz", "binary", seeds.sweep_results),
}
