"""A working project: an amplifier, the model of a stage, recordings of it, and a page that says what to do."""

from __future__ import annotations

from pathlib import Path

from flexdesign.core import data_files
from flexdesign.workflows.scaffolding.folder import write_folder

#: What the project takes from the shipped examples: name in the project, and the file it is a copy of.
COPIES = {
    "amplifier.toml": "geometry/bridge_amplifier.toml",
    "model.toml": "studies/hidden_effect_demo/model.toml",
}
#: The folder of recordings, copied as a whole.
RUNS = "studies/hidden_effect_demo/runs"

README = """# {title}

A project of flexdesign. It works as it is.

| file | content | command |
|---|---|---|
| `amplifier.toml` | a design: dimensions, material, actuator | `flexdesign validate amplifier.toml` |
| `model.toml` | a stage model: mass, stiffness, gain, hysteresis | `flexdesign simulate model.toml` |
| `runs/` | recordings of that stage; `measurements.toml` says what they are | `flexdesign diagnose model.toml runs` |

The stage has a physical effect that `model.toml` lacks. Find it:

```sh
flexdesign compare model.toml runs                      # how far the model misses the recordings
flexdesign diagnose model.toml runs -o better.toml      # the missing effect, fitted
flexdesign compare better.toml runs                     # the error is now the noise
```

Then replace the files by your own, one after the other:

- Dimensions: change `amplifier.toml`, or try a value with `--set dimensions.hinge_thickness="0.4 mm"`.
- Your part: `part = "my_part.py"` or `part = "bracket.step"` in the design.
- Your stage: `flexdesign validate` writes a `stage_model.toml` for the amplifier, to copy values from.
- Your recordings: `flexdesign import FILES` brings any CSV or MATLAB file into the form of `runs/`.

`flexdesign COMMAND --help` has examples of each command.
"""


def write_project(folder: Path) -> list[Path]:
    """Write a working project into a new folder.

    Parameters
    ----------
    folder
        The folder; it must not exist, or be empty.

    Returns
    -------
    list of Path
        The written files.

    Raises
    ------
    InputError
        If the folder holds something, or cannot be written.
    """
    root = data_files.root()
    title = folder.absolute().name.replace("_", " ").capitalize()
    files: dict[str, str | bytes] = {"README.md": README.format(title=title)}
    files |= {name: (root / source).read_bytes() for name, source in COPIES.items()}
    files |= {f"runs/{path.name}": path.read_bytes() for path in sorted((root / RUNS).iterdir()) if path.is_file()}
    return write_folder(folder, files)
