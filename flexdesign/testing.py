"""Checks for test suites: that FEM and an analytic model agree on a design within a stated tolerance.

In a user's test file::

    from flexdesign.testing import assert_agrees

    def test_my_amplifier():
        assert_agrees("my_amplifier.toml", K_in_output_free="25 %", lambda_output_free="12 %")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flexdesign.api.designs import SHORT
from flexdesign.core import units
from flexdesign.core.result_cache import Cache, default_folder
from flexdesign.design import study as studies
from flexdesign.report import terminal
from flexdesign.report.validation import table_1
from flexdesign.workflows.validation import Validation, validate


def assert_agrees(
    design: str | Path,
    *,
    model: str = "PRB",
    overrides: Sequence[str] = (),
    cache: Path | None = None,
    **tolerances: str,
) -> Validation:
    """Assert that an analytic model agrees with FEM, quantity by quantity.

    Parameters
    ----------
    design
        A study or design: a path, or the bare name of a shipped one.
    model
        Which analytic model, as the report's Table 1 names it.
    overrides
        Changed values, as for the CLI's ``--set``.
    cache
        Folder for meshes and solutions; default that of the CLI.
    tolerances
        For each quantity the largest relative deviation from FEM, e.g. ``K_in="10 %"``. A quantity is named by its
        short name (`SHORT`) or by its key in the report. FEM's own error estimate is granted on top.

    Returns
    -------
    Validation
        What was computed, for further checks.

    Raises
    ------
    AssertionError
        If a quantity is off by more, with the whole table.
    InputError
        If the design cannot be used.
    ValueError
        If a tolerance cannot be read, or a quantity or model is unknown.
    """
    if not tolerances:
        raise ValueError("name at least one quantity with its tolerance, such as K_in='10 %'")
    limits = {SHORT.get(name, name): units.from_text(text, "1") for name, text in tolerances.items()}
    found = validate(studies.read(design, overrides), Cache(cache or default_folder()))
    by_key = {comparison.fem.key: comparison for comparison in found.comparisons}
    failures = []
    for key, limit in limits.items():
        if key not in by_key:
            raise ValueError(f"no quantity {key!r} in both FEM and formulas; there are {', '.join(by_key)}")
        error = by_key[key].error(model)
        if error is None:
            raise ValueError(f"{model!r} has no {key!r}; its models are {', '.join(by_key[key].analytic)}")
        granted = limit + (by_key[key].fem.half_width or 0.0) / abs(by_key[key].fem.value)
        if not abs(error) <= granted:
            failures.append(f"{key}: {model} is off by {100 * error:+.1f} %, allowed {100 * granted:.1f} %")
    if failures:
        table = terminal.plain(table_1.table(found))
        raise AssertionError(f"{found.study.design.title}\n" + "\n".join(failures) + f"\n{table}")
    return found
